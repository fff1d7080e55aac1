"""Studies that a STUDY.toml declares, in its order: settings, trainings, tables, figures, views.

`[config]` holds the settings and their defaults; in it "$method" stands for the names of all tables
`[method.NAME]`, and a table with the key `of` for a dataclass of this project, or an instance, with
other values. `counts` names the settings that must be at least 1, and lists of at least one item.
Elsewhere "$name" is the value of a setting, "$name.0" its first item, "{name}" its text, and
"@field" in a label the field of a run.
`[defaults]` holds what every `[[train]]` shares. docs/add-a-study.md explains the grammar.

What has no grammar is a function in `study.py` of the same folder, named with "python": a prior,
rows of a table, a summary, a figure or a view. `check` there refuses settings that don't fit
together; `jobs` or `compute_tables` takes the place of `[[train]]`; without the latter the tables
are what the jobs have kept.
"""

from __future__ import annotations

import dataclasses
import functools
import re
from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NamedTuple

from socialiq.errors import UserError, one_of
from socialiq.foreign import FAILURES, failure
from socialiq.results_folder import Results
from socialiq.types import Row
from socialiq_lab import tables as table_operations
from socialiq_lab.declared_settings import config_class, resolved, variants
from socialiq_lab.jobs import Job
from socialiq_lab.study import Context, Findings, Study, View

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from socialiq import Demonstrations
    from socialiq_lab.gridworld_runs import Learned, Training

KEYS: dict[str, tuple[str, str]] = {
    "train": (
        "rows stage label data",
        "learner preset regularized static runs reciprocal targets checkpoint prior",
    ),
    "table": ("name from", "where regret_at pool mean spread paired python"),
    "summary": ("from nest", "where keep python"),
    "figure": (
        "name x y",
        "table where split join kind by lines styles each panels error text layers rows python "
        "xlabel ylabel ylabels zlabel rotation xscale yscale xlim ylim limits hline vline diagonal "
        "legend label color alpha title size columns words",
    ),
    "view": ("table", "where columns title pivot python"),
}
"""Keys of each table: what it needs unless a function takes its place, and what it may have."""

_OTHERS = ("title", "of_the_thesis", "world", "counts", "config", "tiny", "defaults")

LEARNERS = ("iq_learn", "behaviour_cloning")
DATA = ("trajectories", "transitions")
KINDS = ("lines", "points", "band", "bars", "heatmap")
"""Of a training its learner and the unit of its data, of a figure its kind."""


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
    """Return the study that a STUDY.toml declares.

    Args:
        name: Name of the study.
        content: Content of the STUDY.toml.
        module: The module `study.py` of the same folder; None without one.

    Raises:
        UserError: If `[config]` is missing, or a value in it has no plain type.
    """
    return Study(
        name,
        config_class(name, content, getattr(module, "check", None)),
        lambda config, context: _compute(content, module, config, context),
        lambda results: _figures(_of(results, content, "figure"), module, results),
        lambda results: _views(_of(results, content, "view"), module, results),
        lambda config: _jobs(content, module, config),
        getattr(module, "more_jobs", None),
    )


class _Plan(NamedTuple):
    """Trainings, tables, figures and views of a declaration, its settings filled in."""

    trainings: list[Training]
    tables: list[dict[str, Any]]
    summaries: dict[str, dict[str, Any]]  # parts of the summary by name; "" for the whole
    figures: list[dict[str, Any]]
    views: list[dict[str, Any]]

    @staticmethod
    def of(content: Mapping[str, Any], module: Any, config: Any) -> _Plan:
        """Return the plan, after what the grammar or `study.py` lacks is refused."""
        from socialiq.learners.kernel import described
        from socialiq_lab.gridworld_runs import Training

        trained = variants(content, config)
        tables, summary, figures, views = (
            resolved(content.get(name, empty), config)
            for name, empty in (("table", []), ("summary", {}), ("figure", []), ("view", []))
        )
        parts = {"": summary} if {"from", "python"} & summary.keys() else summary
        if not _computes(module) and "world" not in content:
            raise UserError(
                "STUDY.toml: name its world, or compute its tables in study.py beside it"
            )
        _check([trained, tables, list(parts.values()), figures, views], module)
        world = resolved(content.get("world", ""), config)
        priors = (getattr(module, training.get("prior", ""), None) for training in trained)
        trainings = [
            Training(world, config.seeds, training, described(prior) if prior else {})
            for training, prior in zip(trained, priors, strict=True)
        ]
        return _Plan(trainings, tables, parts, figures, views)

    def derive(self, state: State, module: Any, summary: Mapping[str, Any]) -> dict[str, Any]:
        """Add the tables that follow from those of the state; return the summary.

        Without a module what has no grammar is left out, and what follows from it.
        """
        names = [*state.tables]
        for table in [*self.tables, *self.summaries.values()]:
            if "python" not in table:
                one_of("table", table["from"], names)
            names.append(table.get("name", ""))
        for table in self.tables:
            if "python" in table and module:
                rows = getattr(module, table["python"])(state)
            elif table.get("from") in state.tables:
                rows = table_operations.derived(table, state.tables, state.ground)
            else:
                continue
            state.tables |= table_operations.checked_rows({table["name"]: rows})
        results = dict(summary)
        for name, part in self.summaries.items():
            if "python" in part:
                entries = getattr(module, part["python"])(state) if module else {}
            else:
                rows = state.tables.get(part["from"], [])
                rows = table_operations.where(rows, part.get("where", {}))
                entries = table_operations.nested(rows, *part["nest"], keep=part.get("keep"))
            results |= {name: entries} if name else entries
        return results

    def rehearse(self, config: Any) -> None:
        """Derive, draw and print everything from invented rows, before anything is trained.

        Raises:
            UserError: If a table, a column or another value is wrong.
        """
        ground = SimpleNamespace(optimum=SimpleNamespace(regret=lambda *_: 0.5))
        state = State(config, ground)
        for training in self.trainings:
            rows = state.tables.setdefault(training.declared["rows"], [])
            rows += training.invented()
        state.tables = table_operations.checked_rows(state.tables)
        names = [*state.tables, *(table["name"] for table in self.tables)]
        for entry in [*self.figures, *self.views]:
            layers = [] if {"python", "rows"} & entry.keys() else entry.get("layers", [{}])
            for layer in layers:
                one_of("table", layer.get("table", entry.get("table", entry.get("name"))), names)
        try:
            summary = self.derive(state, None, {})
            results = Results("", dataclasses.asdict(config), state.tables, summary, {})
            _views(self.views, None, results)
            _figures(self.figures, None, results)
        except UserError as error:
            raise UserError(f"STUDY.toml: {error}") from error
        except FAILURES as error:
            raise failure("STUDY.toml", error) from error


def _computes(module: Any) -> bool:
    """Whether `study.py` takes the place of `[[train]]`."""
    return hasattr(module, "jobs") or hasattr(module, "compute_tables")


def _jobs(content: Mapping[str, Any], module: Any, config: Any) -> Sequence[Job]:
    """Refuse what can't be computed or drawn; return the jobs of `study.py`, or one a training."""
    for key in content if module is None else ():
        one_of("key of STUDY.toml", key, _OTHERS + tuple(KEYS))
    plan = _Plan.of(content, module, config)
    if _computes(module):
        own = getattr(module, "jobs", None)
        return list(own(config)) if own else []
    from socialiq_lab.gridworld_runs import train_declared

    plan.rehearse(config)
    jobs = []
    for number, training in enumerate(plan.trainings):
        prior = getattr(module, training.declared.get("prior", ""), None)
        stage = _NO_NAME.sub(" ", training.declared["stage"])
        work = functools.partial(train_declared, prior=prior)
        jobs.append(Job(f"{stage}/{number}", work, training, cost=float(len(training.runs()))))
    return jobs


_NO_NAME = re.compile(r"[^\w ,'()-]")
"""Characters that the name of a folder may lack."""


def _compute(content: Mapping[str, Any], module: Any, config: Any, context: Context) -> Findings:
    """Evaluate what was trained, then compute the tables and the summary in their order."""
    from socialiq_lab import gridworld_runs

    plan = _Plan.of(content, module, config)
    if _computes(module):
        compute = getattr(module, "compute_tables", None)
        findings = compute(config, context) if compute else Findings(context.tables(), {})
        state = State(config, None, findings.tables)
    else:
        findings = Findings({}, {})
        world = resolved(content["world"], config)
        state = State(config, gridworld_runs.world_of(world))
        for job, training in zip(context.jobs, plan.trainings, strict=True):
            prior = getattr(module, training.declared.get("prior", ""), None)
            folder = context.work / job.name
            rows, policies, data = gridworld_runs.declared_rows(training, folder, prior)
            state.data[" ".join(map(str, *training.declared["data"].items()))] = data
            state.tables.setdefault(training.declared["rows"], []).extend(rows)
            state.policies += policies
    state.tables = table_operations.checked_rows(state.tables)
    summary = plan.derive(state, module, findings.summary)
    return findings._replace(tables=state.tables, summary=summary)


def _check(entries_of_tables: Sequence[Sequence[Mapping[str, Any]]], module: Any) -> None:
    """Refuse what the grammar or `study.py` lacks, in the order of `KEYS`, before anything runs."""
    from socialiq.learners.iq_learn.config import PRESETS

    for (table, (needed, options)), entries in zip(KEYS.items(), entries_of_tables, strict=True):
        for entry in entries:
            for key in entry:
                one_of(f"key of {table} in STUDY.toml", key, [*needed.split(), *options.split()])
            needs = "name" if "python" in entry and table == "table" else needed
            missing = [key for key in needs.split() if key not in entry]
            if missing and (table == "table" or "python" not in entry):
                raise UserError(f"STUDY.toml: give each {table} {' and '.join(missing)}")
            functions = [entry.get("python"), entry.get("prior")]
            functions += [entry["rows"]] if table == "figure" and "rows" in entry else []
            for name in filter(None, functions):
                if not callable(getattr(module, name, None)):
                    raise UserError(f"STUDY.toml: study.py beside it has no function {name}")
    for training in entries_of_tables[0]:
        one_of("learner", training.get("learner", LEARNERS[0]), LEARNERS)
        one_of("kind of data", next(iter(training["data"]), ""), DATA)
        if training.get("learner", LEARNERS[0]) == LEARNERS[0]:
            one_of("preset", training.get("preset", ""), tuple(PRESETS))
    for figure in entries_of_tables[3]:
        for layer in (figure, *figure.get("layers", ())):
            one_of("kind of figure", layer.get("kind", KINDS[0]), KINDS)


def _of(results: Results, content: Mapping[str, Any], name: str) -> list[dict[str, Any]]:
    """Return the figures or the views of results, the settings of these filled in."""
    return resolved(content.get(name, []), SimpleNamespace(**results.config))


def _figures(
    declared: Sequence[dict[str, Any]], module: Any, results: Results
) -> dict[str, Figure]:
    from socialiq.plotting import figures

    pictures = {}
    results = dataclasses.replace(results, tables=table_operations.checked_rows(results.tables))
    for figure in declared:
        if {"python", "rows"} & figure.keys() and not module:
            continue
        if "python" in figure:
            pictures |= getattr(module, figure["python"])(results)
            continue
        drawing = results
        if "rows" in figure:
            name = figure["table"] = figure["rows"]
            rows = getattr(module, name)(results)
            drawing = dataclasses.replace(results, tables={**results.tables, name: rows})
        picture = figures.draw(figure, drawing)
        if picture is not None:
            pictures[figure["name"]] = picture
    return pictures


def _views(declared: Sequence[dict[str, Any]], module: Any, results: Results) -> list[View]:
    views = []
    results = dataclasses.replace(results, tables=table_operations.checked_rows(results.tables))
    for view in declared:
        if "python" in view:
            views += getattr(module, view["python"])(results) if module else []
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
