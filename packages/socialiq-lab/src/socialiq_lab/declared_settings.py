"""Settings of a STUDY.toml, and the trainings that follow from them."""

import dataclasses
import importlib
import itertools
import operator
import re
from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any

from socialiq.errors import UserError, one_of
from socialiq.settings import changed


def config_class(
    name: str, content: Mapping[str, Any], check: Callable[[Any], None] | None = None
) -> type[Any]:
    """Return a frozen dataclass of the settings that a STUDY.toml declares.

    Args:
        name: Name of the study.
        content: Content of the STUDY.toml.
        check: Refuses values that don't fit together, after those of `counts` are checked.

    Raises:
        UserError: If `[config]` is missing, or the type of a value can't be told.
    """
    if not isinstance(content.get("config"), Mapping):
        raise UserError(f"{name}: STUDY.toml has no table config: give the settings' defaults")
    fields = []
    for key, value in content["config"].items():
        if isinstance(value, str) and value.startswith("$"):
            value = list(content.get(value[1:], ()))
        if isinstance(value, Mapping) and "of" in value:
            value = settings_of(f"{name}: {key}", **value)
        if isinstance(value, list):
            if not value or len({type(item) for item in value}) > 1:
                raise UserError(f"{name}: {key} must be a list of equal types, and not empty")
            fields.append((key, tuple[type(value[0]), ...], tuple(value)))
        elif value == {}:  # values by name, which the study's `check` refuses or takes
            fields.append((key, dict, dataclasses.field(default_factory=dict)))
        elif isinstance(value, bool | int | float | str) or dataclasses.is_dataclass(value):
            fields.append((key, type(value), value))
        else:
            raise UserError(f"{name}: {key} must be a number, a text, true, false or a list")

    counts = content.get("counts", ())

    def refuse(config: Any) -> None:
        from socialiq.learners.settings import check_counts

        lists = [name for name in counts if isinstance(getattr(config, name), tuple)]
        for name in lists:
            if not getattr(config, name):
                raise UserError(f"{name} must name at least one")
        check_counts(config, [name for name in counts if name not in lists])
        if check is not None:
            check(config)

    namespace = {"__post_init__": refuse, "__reduce__": _as_values}
    return dataclasses.make_dataclass("Config", fields, frozen=True, namespace=namespace)


def _as_values(config: Any) -> tuple[Callable[..., Any], tuple[dict[str, Any]]]:
    """Pickle settings by their values: another process can't import a class that is made here."""
    names = [field.name for field in dataclasses.fields(config)]
    return _of_values, ({name: getattr(config, name) for name in names},)


def _of_values(values: dict[str, Any]) -> Any:
    """Return settings of values that were checked before."""
    namespace = {"__reduce__": _as_values}
    kind = dataclasses.make_dataclass("Config", [*values], frozen=True, namespace=namespace)
    return kind(**values)


def settings_of(name: str, of: str, **changes: Any) -> Any:
    """Return a dataclass of this project, or an instance, with other values.

    Args:
        name: Name of the value, for messages.
        of: MODULE:NAME of the dataclass or the instance.
        **changes: Values of its fields.

    Raises:
        UserError: If there is none of that name.
    """
    module, _, path = of.partition(":")
    if module.split(".")[0] not in ("socialiq", "socialiq_lab", "socialiq_recordings"):
        raise UserError(f"{name} must be a dataclass of socialiq, got {of}")
    try:
        base = operator.attrgetter(path)(importlib.import_module(module))
    except (ImportError, AttributeError) as error:
        raise UserError(f"{name} must be a dataclass of socialiq, got {of}: {error}") from error
    if not dataclasses.is_dataclass(base):
        raise UserError(f"{name} must be a dataclass of socialiq, got {of}")
    if isinstance(base, type):
        fields = dataclasses.fields(base)
        needed = [field.name for field in fields if field.default is field.default_factory]
        base = base(**{key: changes[key] for key in needed})  # they have neither: both are MISSING
    return changed(base, changes)


def resolved(value: Any, config: Any) -> Any:
    """Return a value of a declaration with every "$name" replaced by that setting's value.

    Raises:
        UserError: If there is no such setting.
    """
    if isinstance(value, Mapping):
        return {key: resolved(item, config) for key, item in value.items()}
    if isinstance(value, list):
        return [resolved(item, config) for item in value]
    if not isinstance(value, str):
        return value
    if value.startswith("$"):
        return _setting(config, value[1:])
    return _IN_TEXT.sub(lambda match: str(_setting(config, match.group(1))), value)


_IN_TEXT = re.compile(r"\{([a-z_]+(?:\.\d+)?)\}")


def _setting(config: Any, name: str) -> Any:
    setting, _, index = name.partition(".")
    if not hasattr(config, setting):
        raise UserError(f"STUDY.toml: {name} is no setting of the table config")
    value = getattr(config, setting)
    return value[int(index)] if index else value


def variants(content: Mapping[str, Any], config: Any) -> list[dict[str, Any]]:
    """Return the trainings of a declaration, each with the values of its runs.

    Defaults are laid under, `each` and the grid of `runs` are multiplied out, and the numbers of
    `reciprocal` are added.

    Args:
        content: Content of a STUDY.toml.
        config: Configuration of the study.

    Returns:
        A declaration for each variant whose `if` is not false. Its `runs` list the values of each
        run by name.

    Raises:
        UserError: If a setting is unknown, a column of values is no list, or `reciprocal` names an
            unknown number.
    """
    from socialiq.evaluation.rollout import MODES

    expanded = []
    for train in content.get("train", ()):
        variant = dict(content.get("defaults", {}))
        for key, value in train.items():  # tables in the defaults are merged, but one of data
            below = variant.get(key)
            if isinstance(value, Mapping) and isinstance(below, Mapping) and key != "data":
                value = {**below, **value}
            variant[key] = value
        for values in product_of(resolved(variant.pop("each", {}), config)):
            bound = SimpleNamespace(**dataclasses.asdict(config) | values)
            result = resolved(variant, bound)
            result["runs"] = product_of(result.get("runs", {}))
            for run, (name, of) in itertools.product(
                result["runs"], result.get("reciprocal", {}).items()
            ):
                one_of("number of the runs", of, tuple(run))
                run[name] = 1.0 / run[of]
            if result.get("targets") == "modes":
                result["targets"] = list(MODES.values())
            if result.pop("if", True):
                expanded.append(result)
    return expanded


def product_of(columns: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return every combination of the columns' values, the last column varying fastest.

    Args:
        columns: List of values by column; "modes" stands for the experts' angles.

    Raises:
        UserError: If a column is no list.
    """
    from socialiq.evaluation.rollout import MODES

    lists = [list(MODES.values()) if values == "modes" else values for values in columns.values()]
    for name, values in zip(columns, lists, strict=True):
        if not isinstance(values, list | tuple):
            raise UserError(f'STUDY.toml: {name} must be a list, or "modes", got {values!r}')
    return [dict(zip(columns, values, strict=True)) for values in itertools.product(*lists)]
