"""Studies that a STUDY.toml declares: trainings in a gridworld, tables, summary, figures, views.

`[config]` holds the settings and their defaults. Elsewhere "$name" is the value of a setting,
"$name.0" its first item, "{name}" its text, and "@field" in a label the field of a run.
`[defaults]` holds what every `[[train]]` shares. docs/add-a-study.md explains the grammar.

What has no grammar is a function in `study.py` beside the declaration, named with "python": a
prior, rows of a table, a summary, a figure or a view. A `study.py` with a `Config`, `jobs` or
`compute_tables` of its own takes the place of `[config]` and `[[train]]`.
"""

from __future__ import annotations

import dataclasses
import itertools
import re
from collections.abc import Callable, Mapping, Sequence
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NamedTuple

from socialiq import UserError
from socialiq.types import Row
from socialiq_lab import tables as table_operations
from socialiq_lab.study import Context, Findings, Study, View

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from socialiq.demonstrations.dataset import Demonstrations
    from socialiq.nn.q_policy import QPolicy
    from socialiq.results_folder import Results


class Learned(NamedTuple):
    """A trained policy of a declared study."""

    label: Row  # of its rows
    static: Any  # configuration of its learner
    run: Any  # its hyperparameters
    data: Demonstrations  # that it learned from
    policy: QPolicy


@dataclasses.dataclass
class State:
    """Results of a declared study so far; argument of its functions in `study.py`."""

    config: Any
    ground: Any  # the world; None where `study.py` computes the tables
    tables: dict[str, list[Row]] = dataclasses.field(default_factory=dict)
    policies: list[Learned] = dataclasses.field(default_factory=list)  # in order of declaration
    data: dict[str, list[Demonstrations]] = dataclasses.field(default_factory=dict)
    """Data sets by their declaration, as `"trajectories 60"`."""


def declared_study(name: str, content: Mapping[str, Any], module: Any = None) -> Study:
    """Return the study of a STUDY.toml.

    Args:
        name: Name of the study.
        content: Content of the file.
        module: Module `study.py` beside it, if there is one.

    Raises:
        UserError: If `[config]` is missing, or a value in it has no plain type.
    """
    config = getattr(module, "Config", None) or config_class(name, content)
    return Study(
        name,
        config,
        lambda config, context: _compute(content, module, config, context),
        lambda results: _figures(content, module, results),
        lambda results: _views(content, module, results),
        getattr(module, "jobs", None),
        getattr(module, "more_jobs", None),
    )


def config_class(name: str, content: Mapping[str, Any]) -> type[Any]:
    """Return a frozen dataclass of the settings that a STUDY.toml declares.

    Raises:
        UserError: If `[config]` is missing, or the type of a value can't be told.
    """
    if not isinstance(content.get("config"), Mapping):
        raise UserError(f"{name}: STUDY.toml has no table config: give the settings' defaults")
    fields = []
    for key, value in content["config"].items():
        if isinstance(value, list):
            if not value or len({type(item) for item in value}) > 1:
                raise UserError(f"{name}: {key} must be a list of equal types, and not empty")
            fields.append((key, tuple[type(value[0]), ...], tuple(value)))
        elif isinstance(value, bool | int | float | str):
            fields.append((key, type(value), value))
        else:
            raise UserError(f"{name}: {key} must be a number, a text, true, false or a list")
    return dataclasses.make_dataclass("Config", fields, frozen=True)


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


def _function(module: Any, name: str) -> Callable[..., Any]:
    """Return a function of `study.py`."""
    function = getattr(module, name, None)
    if not callable(function):
        raise UserError(f"STUDY.toml: study.py beside it has no function {name}")
    return function


def _compute(content: Mapping[str, Any], module: Any, config: Any, context: Context) -> Findings:
    """Train every variant, then compute the tables and the summary in their order."""
    from socialiq.evaluation.exact import Ground

    findings = Findings({}, {})
    if hasattr(module, "compute_tables"):
        findings = module.compute_tables(config, context)
        state = State(config, None, findings.tables)
    else:
        state = State(config, Ground.of(resolved(content["world"], config)))
    for variant in variants(content, config):
        _train(state, variant, module, context)
    for table in content.get("table", ()):
        specification = resolved(table, config)
        if "python" in specification:
            rows = _function(module, specification["python"])(state)
        else:
            rows = table_operations.derived(specification, state.tables, state.ground)
        state.tables[specification["name"]] = rows
    declared = resolved(content.get("summary", {}), config)
    summary = findings.summary
    if "python" in declared:
        summary = _function(module, declared["python"])(state)
    elif declared:
        rows = state.tables[declared["from"]]
        summary = table_operations.nested(rows, *declared["nest"], keep=declared.get("keep"))
    return findings._replace(tables=state.tables, summary=summary)


def variants(content: Mapping[str, Any], config: Any) -> list[dict[str, Any]]:
    """Return the trainings of a declaration: defaults laid under, `each` multiplied out."""
    expanded = []
    for train in content.get("train", ()):
        variant = dict(content.get("defaults", {}))
        for key, value in train.items():  # tables in the defaults are merged, but one of data
            below = variant.get(key)
            if isinstance(value, Mapping) and isinstance(below, Mapping) and key != "data":
                value = {**below, **value}
            variant[key] = value
        each = variant.pop("each", {})
        for values in _product(resolved(each, config)):
            bound = SimpleNamespace(**dataclasses.asdict(config) | values)
            result = resolved(variant, bound)
            if result.pop("if", True):
                expanded.append(result)
    return expanded


def _product(columns: Mapping[str, Sequence[Any]]) -> list[dict[str, Any]]:
    """Return every combination of values, the last name varying fastest."""
    return [
        dict(zip(columns, values, strict=True)) for values in itertools.product(*columns.values())
    ]


def _train(state: State, variant: Mapping[str, Any], module: Any, context: Context) -> None:
    """Train the runs of a variant in one program, and add their rows to the state."""
    from socialiq_lab import gridworld_runs as gridworlds

    seeds = state.config.seeds
    data = _datasets(state, variant["data"])
    static, numbers = gridworlds.learner_of(variant)
    runs = [
        dataclasses.replace(numbers, **values, seed=seed, dataset=index % len(data))
        for values in _product(gridworlds.axes(variant.get("runs", {})))
        for index, seed in enumerate(seeds)
    ]
    for name, field in variant.get("reciprocal", {}).items():
        runs = [dataclasses.replace(run, **{name: 1.0 / getattr(run, field)}) for run in runs]
    prior = _function(module, variant["prior"]) if "prior" in variant else None
    report = context.on_stage(variant["stage"])
    chunk = variant.get("checkpoint")
    trained = gridworlds.train_variant(state.ground, static, runs, data, report, chunk, prior)
    labels: list[Row] = [
        {
            name: getattr(run, value[1:]) if str(value).startswith("@") else value
            for name, value in variant["label"].items()
        }
        for run in runs
    ]
    rows = state.tables.setdefault(variant["rows"], [])
    if chunk is not None:
        rows += gridworlds.checkpoint_rows(trained.history, runs, labels)
        return
    policies = [trained.policy(number) for number in range(len(runs))]
    targets = gridworlds.axes({"angle": variant.get("targets", [None])})
    for target in targets["angle"]:
        for label, run, policy in zip(labels, runs, policies, strict=True):
            angle = run.angle if target is None else target
            row_label = label | {"target_angle": angle}
            rows += gridworlds.rows_of(state.ground, [policy], angle, row_label, [run.seed])
    state.policies += [
        Learned(label | {"target_angle": run.angle}, static, run, data[run.dataset], policy)
        for label, run, policy in zip(labels, runs, policies, strict=True)
    ]


def _datasets(state: State, declared: Mapping[str, int]) -> list[Demonstrations]:
    """Return a data set for each seed, made at its first use."""
    from socialiq.evaluation import rollout as experts

    kinds = {
        "trajectories": experts.trajectory_datasets,
        "transitions": experts.transition_datasets,
    }
    ((kind, number),) = declared.items()
    name = f"{kind} {number}"
    if name not in state.data:
        state.data[name] = kinds[kind](state.ground.table, state.config.seeds, number)
    return state.data[name]


def _figures(content: Mapping[str, Any], module: Any, results: Results) -> dict[str, Figure]:
    from socialiq_lab import figures

    pictures = {}
    settings = SimpleNamespace(**results.config)
    for declared in content.get("figure", ()):
        specification = resolved(declared, settings)
        if "python" in specification:
            pictures |= _function(module, specification["python"])(results)
            continue
        drawn = results
        if "rows" in specification:
            name = specification["table"] = specification["rows"]
            tables = {**results.tables, name: _function(module, name)(results)}
            drawn = dataclasses.replace(results, tables=tables)
        picture = figures.draw(specification, drawn)
        if picture is not None:
            pictures[specification["name"]] = picture
    return pictures


def _views(content: Mapping[str, Any], module: Any, results: Results) -> list[View]:
    views = []
    settings = SimpleNamespace(**results.config)
    for declared in content.get("view", ()):
        view = resolved(declared, settings)
        if "python" in view:
            views += _function(module, view["python"])(results)
            continue
        if view["table"] not in results.tables:  # it was empty
            continue
        rows = table_operations.where(results.tables[view["table"]], view.get("where", {}))
        if "pivot" in view:
            rows = table_operations.pivoted(rows, *view["pivot"])
        columns = view.get("columns")
        printed = [{name: row[name] for name in columns} for row in rows] if columns else rows
        views.append(View(printed, view.get("title", "")))
    return views
