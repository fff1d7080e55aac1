"""Comparisons: methods, their settings chosen on development seeds and judged on others, tables."""

import dataclasses
import itertools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from socialiq import Demonstrations, UserError
from socialiq.errors import one_of
from socialiq.evaluation import exact, rollout
from socialiq.settings import changed

GRIDWORLDS = ("crossing5", "crossing7")
WORLDS = (*GRIDWORLDS, "intersection")

DEVELOPMENT = "development"
FRESH = "fresh"
"""Phases: settings are chosen in the first, and the table is of the second."""

Setting = tuple[tuple[str, float], ...]
"""Settings by name that differ from the world's."""


def product(**values: Sequence[float]) -> tuple[Setting, ...]:
    """Return the grid of all combinations of values."""
    combinations = itertools.product(*values.values())
    return tuple(tuple(zip(values, combination, strict=True)) for combination in combinations)


def setting_name(setting: Setting) -> str:
    """Return a setting in one cell of a table."""
    return ", ".join(f"{name} {value:g}" for name, value in setting)


@dataclass(frozen=True)
class Method:
    """A row of a comparison: a table `[method.NAME]` of its STUDY.toml.

    Attributes:
        name: Name of the row and of its folders.
        label: Name in tables and figures.
        learner: Name of its learner; by default its own name.
        settings: Grid from which one is chosen on the development seeds; declared as `grid`.
        told: Inputs in addition to observations and actions.
        serves: What one network serves: an "angle", a "mode" (the nearest demonstrator's), or "all"
            angles.
        of_mode: Whether it learns from the nearest demonstrator's episodes alone.
        worlds: Where it runs.
        soft: Whether its stochastic policy means something.
        peer: Library whose learner it is, run in a separate environment.
        fixed: Settings of the learner that make the method.
    """

    name: str
    label: str
    learner: str
    settings: tuple[Setting, ...] = ()
    told: tuple[str, ...] = ()
    serves: str = "angle"
    of_mode: bool = False
    worlds: tuple[str, ...] = WORLDS
    soft: bool = True
    peer: str = ""
    fixed: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    @property
    def readouts(self) -> tuple[exact.Readout, ...]:
        """Evaluated action selections."""
        return exact.READOUTS if self.soft else exact.READOUTS[:1]

    def setting_of(self, name: str) -> Setting:
        """Return the setting of that name in the grid."""
        return next(setting for setting in self.settings if setting_name(setting) == name)

    def served(self, angles: tuple[float, ...]) -> dict[float, tuple[float, ...]]:
        """Return the angle that each network is trained for, and the angles that it serves."""
        if self.serves == "all":
            return {0.0: angles}
        if self.serves == "angle":
            return {angle: (angle,) for angle in angles}
        served = {
            mode_angle: tuple(angle for angle in angles if nearest_mode(angle) == mode)
            for mode, mode_angle in rollout.MODES.items()
        }
        return {angle: group for angle, group in served.items() if group}


def declared_methods(content: Mapping[str, Any]) -> dict[str, Method]:
    """Return the methods of a STUDY.toml by name, in its order."""
    methods = {}
    for name, declared in content["method"].items():
        fields: dict[str, Any] = {
            key: tuple(value) if isinstance(value, list) else value
            for key, value in ({"learner": name} | declared).items()
            if key != "grid"
        }
        grid = product(**declared["grid"]) if "grid" in declared else ()
        of_mode = declared.get("of_mode", declared.get("serves") == "mode")
        methods[name] = Method(**fields | {"name": name, "settings": grid, "of_mode": of_mode})
    return methods


@dataclass(frozen=True)
class Recipe:
    """A learner with its settings, trained alike on several sets of demonstrations.

    Attributes:
        static: Its static configuration; the type says which learner it is.
        numbers: Its hyperparameters, except seed and data set.
    """

    static: Any
    numbers: Any

    @property
    def online(self) -> bool:
        """Whether it acts in the environment."""
        return getattr(self.static, "online", False)


def declared_recipes(
    declared: Mapping[str, Mapping[str, Any]], bases: Mapping[str, Any]
) -> dict[str, Any]:
    """Return recipes by name, each a change of another recipe.

    Args:
        declared: Changes of attributes by name; those of `static` and `numbers` are tables. The key
            `of` names the recipe that is changed: a base, or one that is declared before it.
            Without the key it is the base of the same name.
        bases: Recipes to begin with, by name.

    Returns:
        The declared recipes, in their order.
    """
    recipes: dict[str, Any] = {}
    for name, changes in declared.items():
        options = {key: value for key, value in changes.items() if key != "of"}
        recipes[name] = changed({**bases, **recipes}[changes.get("of", name)], options)
    return recipes


def nearest_mode(angle: float) -> str:
    """Return the mode of the nearest angle; of two equally near ones the more egoistic."""
    return min(rollout.MODES, key=lambda mode: abs(rollout.MODES[mode] - angle))


def of_modes(data: Demonstrations, modes: Sequence[str]) -> Demonstrations:
    """Return the episodes of some modes.

    Args:
        data: Demonstrations of one or more modes.
        modes: Names of the modes that are kept.

    Returns:
        The episodes of these modes, in their order.
    """
    numbers = [number for number, name in enumerate(data.mode_names) if name in modes]
    return data.select(np.flatnonzero(np.isin(data.episode_modes, numbers)))


def check_names(config: Any, **choices: Collection[str]) -> None:
    """Refuse names in fields of a study's configuration that are not among the field's choices.

    Raises:
        UserError: The line names the choices.
    """
    for field, names in choices.items():
        for name in getattr(config, field):
            one_of(field.removesuffix("s"), name, tuple(names))


def cells_of(
    config: Any, methods: Mapping[str, Method], worlds: Sequence[str] = WORLDS
) -> list[tuple[str, Method]]:
    """Return pairs of a world and a method that runs in it, in the order of a comparison's table.

    Args:
        config: Configuration with the fields `worlds`, `methods`, `seeds` and `development_seeds`.
        methods: Known methods by name.
        worlds: Known worlds.

    Raises:
        UserError: If a world or method is unknown, a setting empty, or a seed used twice.
    """
    check_names(config, worlds=worlds, methods=methods)
    for name, value in vars(config).items():
        if isinstance(value, tuple) and not value:
            raise UserError(f"{name} must name at least one")
    if len({*config.worlds}) < len(config.worlds):
        raise UserError("a world is named twice: name each once")
    if {*config.development_seeds} & {*config.seeds}:
        raise UserError("a seed of development can't be a seed of the table: name others")
    pairs = itertools.product(config.worlds, map(methods.__getitem__, config.methods))
    return [(world, method) for world, method in pairs if world in method.worlds]


def as_file_name(label: Any) -> str:
    """Return a name as that of a file or a folder."""
    return "".join(letter if letter.isalnum() else "_" for letter in str(label))
