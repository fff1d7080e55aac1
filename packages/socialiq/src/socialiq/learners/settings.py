"""Settings that learners are composed of: each field's meaning and range, written once.

A field's annotation names its range (`Count`, `Share`, `Positive`, ...), which `Settings` checks. A
learner has two frozen dataclasses: a config, which shapes the compiled program, and its
hyperparameters, which may differ between the runs of a program. Both are composed of the parts
below; a learner repeats a field only to give it another default.
"""

from __future__ import annotations

import inspect
import math
import typing
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass
from functools import cache
from typing import Annotated, Any, Literal

import numpy as np

from socialiq.errors import UserError, one_of
from socialiq.nn.view import CHOICES
from socialiq.social.angle import check_angle
from socialiq.types import Transitions

Rule = Callable[[str, Any], None]
"""Given a field's name and value, raises `UserError` if the value is out of range."""


def _option(name: str) -> str:
    """Return the option of a command that changes a setting."""
    return f"--{name}" if name in ("angle", "seed", "strength") else f"--set {name}"


def _range(words: str, holds: Callable[[Any], bool]) -> Rule:
    def rule(name: str, value: Any) -> None:
        if not holds(value):
            raise UserError(f"{name} {words}, got {value} ({_option(name)})")

    return rule


def _name(names: Any) -> Rule:
    return lambda name, value: one_of(f"value of {_option(name)}", value, tuple(names))


_count = _range("must be at least 1", lambda value: value >= 1)
_not_negative = _range("must be 0 or more", lambda value: math.isfinite(value) and value >= 0)
_above_zero = _range("must be above 0", lambda value: math.isfinite(value) and value > 0)
_share = _range("must lie in [0, 1]", lambda value: 0.0 <= value <= 1.0)
_seed = _range("must lie in [0, 2^32)", lambda value: 0 <= value < 2**32)
_widths = _range("must be widths of at least 1", lambda widths: all(width >= 1 for width in widths))

Count = Annotated[int, _count]
NotNegative = Annotated[float, _not_negative]
Natural = Annotated[int, _not_negative]
Positive = Annotated[float, _above_zero]
Finite = Annotated[float, _range("must be a finite number", math.isfinite)]
Share = Annotated[float, _share]
Rate = Annotated[float, _range("must lie in (0, 1]", lambda value: 0.0 < value <= 1.0)]
Discount = Annotated[float, _range("must lie in [0, 1)", lambda value: 0.0 <= value < 1.0)]
Seed = Annotated[int, _seed]
Angle = Annotated[float, lambda _field, value: check_angle(value)]
Angles = Annotated[
    tuple[float, ...], lambda _field, angles: [check_angle(angle) for angle in angles]
]
Widths = Annotated[tuple[int, ...], _widths]
ViewName = Annotated[str, _name(CHOICES)]


class Settings:
    """Base of all settings: refuses values outside their fields' ranges, NaN among them."""

    def __post_init__(self) -> None:
        """Raise `UserError` for a field out of its range; a `Literal` has its names."""
        for name, rule in _rules(type(self)).items():
            value = getattr(self, name)
            try:
                if value is not None:
                    rule(name, value)
            except TypeError as error:
                raise UserError(f"{_option(name)} can't be {value!r}: {error}") from error


@cache
def _rules(kind: type) -> dict[str, Rule]:
    """Return the rule of each field; a class that redefines a field without one keeps it."""
    rules = {}
    for base in reversed(kind.__mro__):
        try:
            annotations = inspect.get_annotations(base, eval_str=True)
        except NameError:  # of a class of the user's own whose types are not global
            continue
        for name, hint in annotations.items():
            for alternative in (hint, *typing.get_args(hint)):
                if typing.get_origin(alternative) is Literal:
                    rules[name] = _name(typing.get_args(alternative))
                elif typing.get_origin(alternative) is Annotated:
                    rules[name] = alternative.__metadata__[0]
    return rules


@dataclass(frozen=True, kw_only=True)
class Network(Settings):
    """Shape of a learner's network."""

    hidden: Widths = (64, 64)
    """Widths of the hidden layers."""
    activation: Literal["relu", "elu"] = "relu"
    """Between the layers."""
    view: ViewName = "flat"
    """Encoding of the vehicles of the intersection for the network; a name of `nn.view.CHOICES`."""


@dataclass(frozen=True, kw_only=True)
class Replay(Settings):
    """Memory of the learner's own rows."""

    replay_capacity: Count = 100_000
    """Size of the replay ring."""


@dataclass(frozen=True, kw_only=True)
class DrawnAngles(Settings):
    """Social angles that one network is trained for; they are drawn for rows and episodes."""

    low: Angle = 0.0
    """Smallest social angle trained for, in degrees."""
    high: Angle = 90.0
    """Largest social angle trained for, in degrees."""
    margin: NotNegative = 5.0
    """Degrees beyond both ends in which angles are also drawn: a network is least accurate at the
    edge of its data, and the two ends are used most."""
    high_from: float = 65.0
    """Angle in degrees from which `high_share` counts."""
    high_share: Share | None = None
    """Share of the drawn angles beyond `high_from`, for rows and for acting; None: uniform."""

    def __post_init__(self) -> None:
        """Refuse a range without angles."""
        super().__post_init__()
        if self.low > self.high:
            raise UserError(f"angles from {self.low:g} to {self.high:g}: give the smaller first")

    def check_high_share(self) -> None:
        """Refuse a share of high angles where the range doesn't reach on both sides of them."""
        if self.high_share is not None and not self.low < self.high_from < self.high:
            raise UserError(
                f"--set high_from={self.high_from:g}: give an angle between {self.low:g} and "
                f"{self.high:g}"
            )


@dataclass(frozen=True, kw_only=True)
class LearnerConfig(Network):
    """Choices that shape the program of a learner from demonstrations."""

    input_scale: Positive = 1.0
    """Common factor of all features before the first layer, for features far from 1; a factor for
    each feature would change which states are near each other. Only with view flat."""
    batch_size: Count = 64
    """Demonstrated transitions of an update; a learner with a replay draws as many from it."""
    updates: Count = 6000
    """Gradient steps of a run."""
    schedule: Literal["constant", "linear"] = "constant"
    """Learning rate over the run: constant, or falling linearly to 0 at its end."""
    averaging: Share = 0.0
    """Share of the network that each update mixes into the average of its weights, of which the
    policy is then made (Polyak and Juditsky 1992, with exponential forgetting); the average is
    plain until 1/share updates. 0: the policy is the last network."""

    def __post_init__(self) -> None:
        """Refuse names and sizes that make no run."""
        super().__post_init__()
        if self.input_scale != 1.0 and self.view != "flat":
            raise UserError(
                f"--set input_scale is of --set view=flat, not {self.view}: leave it out"
            )


@dataclass(frozen=True, kw_only=True)
class Optimiser(Settings):
    """Numbers of Adam, and the seed of a run."""

    learning_rate: Positive = 3e-4
    """Adam's learning rate, the first one where it falls."""
    seed: Seed = 0
    """Seed of the network, the sampling and the acting."""


@dataclass(frozen=True, kw_only=True)
class Averaged(Optimiser):
    """Numbers of Adam with a network that follows."""

    polyak: Rate = 0.005
    """τ_target, the share of the network mixed at each update into its target network, or into the
    running average that is the policy."""


@dataclass(frozen=True, kw_only=True)
class Dataset(Settings):
    """Demonstrations of a run."""

    dataset: Natural = 0
    """Index of the set of demonstrations that this run learns from."""


@dataclass(frozen=True, kw_only=True)
class CosineRate(Averaged):
    """Numbers of Adam with a rate that falls as a cosine."""

    final_rate: Share = 0.02
    """Learning rate at the end, as a share of the first."""


@dataclass(frozen=True, kw_only=True)
class Exploration(Averaged):
    """Numbers of Adam with a rate that falls linearly, and of random actions that become fewer."""

    final_learning_rate: Positive = 3e-4
    """Adam's final learning rate; in between it falls linearly."""
    exploration: Share = 0.05
    """Share of random actions, after it has fallen from 1."""
    exploration_fall: Share = 0.2
    """Share of the run during which it falls; 0: it doesn't begin at 1."""

    def exploring(self, progress: float) -> float:
        """Return the share of random actions when this share of the run is done."""
        if progress >= self.exploration_fall:
            return self.exploration
        return 1.0 - (1.0 - self.exploration) * progress / self.exploration_fall


@dataclass(frozen=True)
class LearnerHyperparameters(Averaged, Dataset):
    """Numbers of one run, all traced: a grid of runs shares one program. Defaults: Table C.1."""

    angle: Angle = 0.0
    """α of the reward R(α), in degrees."""
    strength: NotNegative = 1.0
    """λ, by which R(α) is scaled."""
    _: KW_ONLY
    temperature: Positive = 1.0
    """τ of Eq 2.5."""
    discount: Discount = 0.99
    """γ."""


def _checks(rule: Rule) -> Callable[[Any, Sequence[str]], None]:
    def check(config: Any, names: Sequence[str]) -> None:
        """Refuse fields that are out of range; for configs that are no `Settings`.

        Args:
            config: Object with the fields.
            names: Names of the fields.

        Raises:
            UserError: If a field is out of range.
        """
        for name in names:
            rule(name, getattr(config, name))

    return check


check_counts, check_shares = map(_checks, (_count, _share))
"""Given a config and names of fields, raise `UserError` if one is out of range."""


def check_widths(widths: Sequence[int]) -> None:
    """Raise `UserError` if a layer has no unit."""
    _widths("hidden", widths)


def check_seed(seed: int) -> None:
    """Raise `UserError` if a seed is negative or has more than 32 bits."""
    _seed("seed", seed)


def check_seeds(seeds: Sequence[int]) -> None:
    """Raise `UserError` if a seed is out of range, or named twice."""
    for seed in seeds:
        check_seed(seed)
    if len({*seeds}) < len(seeds):
        raise UserError("a seed is named twice: name each once")


def listed(hyperparameters: Any, datasets: Any, simulator: Any) -> tuple[Any, Any]:
    """Return lists of runs and sets, of which one may stand alone; refuse a wrong set or world.

    Args:
        hyperparameters: Numbers of each run, or those of one run.
        datasets: Sets of demonstrations, or one set.
        simulator: A compiled world; None without.

    Returns:
        The sequence of hyperparameters, and the sequence of sets.

    Raises:
        UserError: If a set has no returns, or the world can't be advanced.
    """
    if not isinstance(hyperparameters, Sequence):
        hyperparameters = [hyperparameters]
    datasets = datasets if isinstance(datasets, Sequence) else [datasets]
    for what, values, name in (
        ("datasets", datasets, "returns"),
        ("simulator", [] if simulator is None else [simulator], "advance"),
    ):
        for value in values:
            if not hasattr(value, name):
                raise UserError(
                    f"{what} has a {type(value).__name__}: pass Demonstrations, a gridworld by "
                    "make(NAME), and an environment by before_chunk=acting_in(...)"
                )
    return hyperparameters, datasets


def check_social(datasets: Sequence[Transitions]) -> None:
    """Refuse to train a dial on demonstrations without social rewards.

    Raises:
        UserError: If r_social is 0 in all of them: such a dial is the same at every angle.
    """
    if not any(np.any(data.returns("instantaneous", 1.0).social) for data in datasets):
        raise UserError(
            "the demonstrations have no social rewards, so a dial of them would drive alike at "
            "every angle: give pairs (`r_env`, `r_social`), or train a policy without an angle"
        )


def check_fit(
    runs: Sequence[Any], sets: int | None, online: bool, acts: bool, shapes: Sequence[Any]
) -> tuple[int, int]:
    """Refuse runs whose data and world don't fit together, before any work is done.

    Args:
        runs: Hyperparameters of each run.
        sets: Number of sets of demonstrations; None for a learner without demonstrations.
        online: Whether the learner acts in a world.
        acts: Whether a world is given, or experience from one.
        shapes: (features, actions) of each set of demonstrations and of the world.

    Returns:
        The (features, actions) that all shapes have.

    Raises:
        UserError: The line says which part is missing, has no use, or doesn't fit.
    """
    if not runs:
        raise UserError("no runs: pass at least one set of hyperparameters")
    if sets == 0:
        raise UserError("no demonstrations: pass at least one set, or train without them")
    if sets is not None and max(run.dataset for run in runs) >= sets:
        raise UserError(f"a run names a set of demonstrations beyond the {sets} given")
    if online and not acts:
        raise UserError("online training needs a world: name one (--world), or train offline")
    if acts and not online:
        raise UserError("offline training takes no world: drop it (--world), or train online")
    distinct = sorted({tuple(shape) for shape in shapes})
    if len(distinct) != 1:
        raise UserError(
            f"data and world differ in (features, actions): {distinct}: they belong to another "
            "world; record the data in this one, with a clock if it has one"
        )
    return distinct[0]
