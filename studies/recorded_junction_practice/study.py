"""A dial at a recorded junction from recorded drivers alone, without and with practice.

The world is made of recordings (`recordings.world`). Recorded drivers show few of the states that
their dials get into. With practice the dials drive in this world and learn again from what they
met. The dials, clones of the same rows, the calibrated drivers and rules of known courtesy drive
the same episodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from socialiq.audit.evidence.outcomes import Outcomes
from socialiq.demonstrations import files
from socialiq.plotting.style import figure, finish
from socialiq.results_folder import Results
from socialiq.statistics.comparisons import paired_difference
from socialiq.storage import read_json
from socialiq.types import Ending, Row
from socialiq_lab.study import Context, Findings, Study, View
from socialiq_recordings.world.recorded_world import RecordedWorld
from studies.recorded_junction_practice.work import (
    HUMAN,
    MIXTURES,
    PRACTICE,
    PRACTISED,
    VALUES,
    WORLD,
    Config,
    driven,
    plan,
    slug,
)

_SIDES = ("r_env", "r_social")
_INKS = ("#1b7837", "#762a83")
_APART = 1.0  # both rewards; the angles of a shorter line are not written

CLONE = "clone: "
"""Beginning of the name of a clone, before its mixture's."""


def compute_tables(config: Config, context: Context) -> Findings:
    """Return a row for each driver and angle, and the turn of each mixture's dials."""
    work = context.work
    angles: list[Row] = []
    turns: list[Row] = []
    values: list[Row] = []
    drivers = [_row(name, [runs]) for name, runs in driven(work / "drivers").items()]
    summary = {}
    for mixture in MIXTURES:
        outcomes = driven(work / "driven" / slug(mixture))
        dials = {
            angle: [outcomes[f"dial {seed} {angle:g}"] for seed in config.seeds]
            for angle in config.angles
        }
        for angle, runs in dials.items():
            angles.append({"mixture": mixture, "asked": angle} | _row("dial", runs))
        clones = [outcomes[f"clone {seed}"] for seed in config.seeds]
        drivers.append(_row(CLONE + mixture, clones))
        turned = _turns(mixture, dials)
        turns += turned
        summary[mixture] = {row["reward"]: row["difference"] for row in turned}
        if config.checked:
            values.append({"mixture": mixture} | read_json(work / "dials" / slug(mixture) / VALUES))
    counts = files.load(work / "world" / HUMAN).counts().items()
    world = RecordedWorld.load(work / "world" / WORLD)
    about = {name: world.provenance[name] for name in ("vehicles", "egos", "closures")}
    tables = {
        "angles": angles,
        "turns": turns,
        "drivers": drivers,
        "data": [{"driver": name, "episodes": n, "decisions": rows} for name, (n, rows) in counts],
        "values": values,
        "practice": read_json(work / "dials" / slug(PRACTISED) / PRACTICE),
    }
    return Findings(tables, {"world_sha256": world.sha256} | about | summary)


def _mean(runs: Sequence[Outcomes]) -> np.ndarray:
    """Return the totals of each episode, the mean over training seeds."""
    return np.mean([run.totals for run in runs], axis=0)


def _row(name: str, runs: Sequence[Outcomes]) -> Row:
    """Return means over episodes and seeds; intervals over episodes, ranges over seeds."""
    row: Row = {"driver": name}
    for side, values in zip(_SIDES, _mean(runs).T, strict=True):
        half = 1.96 * float(values.std(ddof=1)) / np.sqrt(len(values))
        mean = float(values.mean())
        row |= {side: mean, f"{side}_low": mean - half, f"{side}_high": mean + half}
        run_means = [float(run.totals[:, _SIDES.index(side)].mean()) for run in runs]
        row |= {f"{side}_least": min(run_means), f"{side}_largest": max(run_means)}
    shares = {
        "arrival": [run.ending == Ending.ARRIVAL for run in runs],
        "at_fault": [run.at_fault for run in runs],
        "struck": [run.struck for run in runs],
        "timeout": [run.ending == Ending.TIMEOUT for run in runs],
        "closed_line": [run.ending == Ending.OTHER for run in runs],
    }
    return row | {name: float(np.mean(result)) for name, result in shares.items()}


def _turns(mixture: str, dials: dict[float, list[Outcomes]]) -> list[Row]:
    """Return the change of both rewards from the first angle to the last, paired by episode."""
    first, last = (list(dials.values())[end] for end in (0, -1))
    rows: list[Row] = []
    for column, side in enumerate(_SIDES):
        change = paired_difference(_mean(last)[:, column], _mean(first)[:, column])
        run_changes = [
            float(new.totals[:, column].mean() - old.totals[:, column].mean())
            for new, old in zip(last, first, strict=True)
        ]
        label = {"mixture": mixture, "reward": side, "difference": change.mean}
        ends = {"low": change.low, "high": change.high, "p": change.p}
        rows.append(label | ends | {"least": min(run_changes), "largest": max(run_changes)})
    return rows


def draw(results: Results) -> dict[str, Figure]:
    """Draw r_social over r_env: a line for each mixture's dials, points for the others."""
    picture = figure(7.6, 4.6)
    axes = picture.subplots()
    inks = dict(zip(MIXTURES, _INKS, strict=True))
    for mixture, ink in inks.items():
        rows = [row for row in results.tables["angles"] if row["mixture"] == mixture]
        if rows:
            _line(axes, rows, ink, f"dial: {mixture}")
    markers = iter("*>soD^vP")
    for row in results.tables["drivers"]:
        name = row["driver"]
        of = name.removeprefix(CLONE)
        ink, marker = (inks[of], "X") if of in inks else ("#6e6e6e", next(markers))
        position = row["r_env"], row["r_social"]
        axes.plot(*position, label=name, color=ink, marker=marker, markersize=6, linestyle="")
    finish(axes, xlabel="mean r_env of an episode", ylabel="mean r_social of an episode")
    handles, names = axes.get_legend_handles_labels()
    picture.legend(handles, names, loc="outside right upper", frameon=False, fontsize=7)
    return {"trade_off": picture}


def _line(axes: Any, rows: Sequence[Row], ink: str, label: str) -> None:
    """Draw the dials of a mixture, with the angle at both ends if they differ."""
    x, y = ([row[side] for row in rows] for side in _SIDES)
    axes.plot(x, y, marker="o", markersize=3, color=ink, label=label)
    first, last = rows[0], rows[-1]
    ends = [(first, "left", -4), (last, "right", 4)]
    if np.hypot(x[-1] - x[0], y[-1] - y[0]) < _APART:
        ends = []
    for row, side, shift in ends:
        position = row["r_env"], row["r_social"]
        axes.annotate(f"{row['asked']:g}°", position, fontsize=7, textcoords="offset points",
                      xytext=(-shift, shift), ha=side, color=ink)  # fmt: skip


def view(results: Results) -> Sequence[View]:
    """Return the tables to print."""
    columns = ("mixture", "asked", "r_env", "r_social", "arrival", "at_fault", "struck", "timeout")
    rows = [{name: row[name] for name in columns} for row in results.tables["angles"]]
    columns = ("driver", "r_env", "r_social", "arrival", "at_fault", "struck", "timeout")
    drivers = [{name: row[name] for name in columns} for row in results.tables["drivers"]]
    turned = "From the first angle to the last, with 95 % intervals; range over seeds"
    checked = results.tables.get("values", [])
    views = (
        [View(checked, "Values of r_env beside rollouts, at the first angle")] if checked else []
    )
    practised = results.tables.get("practice", [])
    views += [View(practised, "Practice, all angles together")] if practised else []
    return [
        View(rows, "Dials, means over training seeds"),
        View(results.tables["turns"], turned),
        View(drivers, "Beside them"),
        *views,
    ]


STUDY = Study(
    name="recorded-junction-practice",
    Config=Config,
    jobs=plan,
    tables=compute_tables,
    figures=draw,
    view=view,
)
