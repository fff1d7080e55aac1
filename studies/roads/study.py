"""Study: three experts, the trio and a dial on other roads, and the intersection's dial there."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.plotting.style import COLORS, figure, finish
from socialiq.storage import read_json
from socialiq.types import Row
from socialiq.worlds.highway.world import world_of
from socialiq_lab.intersection.episodes import CURVE
from socialiq_lab.results import Results, from_csv
from socialiq_lab.study import Context, Findings, Study, View
from socialiq_lab.tables import matching, mean
from studies.roads.config import FINE_TUNED, FROM_SCRATCH, Config, folder, plan
from studies.roads.work import DRIVEN

POLICIES = (
    "expert",
    "trio",
    "dial",
    "intersection's dial, as it is",
    "intersection's dial, fine-tuned",
)
QUANTITIES = ("r_env", "r_social", "score", "score_error", "collision", "arrival", "decisions")


def compute_tables(config: Config, context: Context) -> Findings:
    """Compute every table from the jobs' folders alone."""
    rows: list[Row] = []
    curves: list[Row] = []
    for road in config.roads:
        for seed in config.seeds:
            found = read_json(context.work / folder(road, seed, "driven") / DRIVEN)["rows"]
            rows += [{"seed": seed} | row for row in found]
            for name in (FROM_SCRATCH, FINE_TUNED):
                path = context.work / folder(road, seed, name) / CURVE
                curves += [
                    {"road": road, "seed": seed, "dial": name}
                    | {key: row[key] for key in ("updates", "total")}
                    for row in from_csv(path)
                ]
    means = _means(config, rows)
    summary = {
        "scores": {
            road: {
                policy: mean(matching(means, road=road, policy=policy), "score")
                for policy in POLICIES
            }
            for road in config.roads
        },
        "worlds": {road: world_of(road).description for road in config.roads},
    }
    return Findings({"policies": rows, "means": means, "curves": curves}, summary)


def _means(config: Config, rows: Sequence[Row]) -> list[Row]:
    """Return the means over the seeds."""
    return [
        {"road": road, "policy": policy, "angle": angle}
        | {
            name: mean(matching(rows, road=road, policy=policy, angle=angle), name)
            for name in QUANTITIES
        }
        for road in config.roads
        for policy in POLICIES
        for angle in MODES.values()
    ]


def draw(results: Results) -> dict[str, Figure]:
    """Draw the learning curves, one panel for each road."""
    rows = results.tables["curves"]
    roads = list(dict.fromkeys(row["road"] for row in rows))
    drawn = figure(4.2 * len(roads), 3.2)
    for number, road in enumerate(roads, start=1):
        axes = drawn.add_subplot(1, len(roads), number)
        for name, color in ((FROM_SCRATCH, COLORS["baseline"]), (FINE_TUNED, COLORS["prosocial"])):
            shown = matching(rows, road=road, dial=name)
            for seed in dict.fromkeys(row["seed"] for row in shown):
                one = matching(shown, seed=seed)
                x, y = ([row[key] for row in one] for key in ("updates", "total"))
                axes.plot(x, y, color=color, marker="o", label=name)
        finish(axes, road, 8, xlabel="updates", ylabel="mean J at 0, 45 and 90 degrees")
    return {"curves": drawn}


def view(results: Results) -> list[View]:
    """Select the means."""
    return [View(results.tables["means"], "means over episodes and seeds; score is J at the angle")]


STUDY = Study("roads", Config, compute_tables, draw, view, plan)
