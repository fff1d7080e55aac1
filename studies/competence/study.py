"""Value of demonstrations beyond reinforcement learning on R(α), solved exactly.

All experts of the 7x7 world also drive comfortably: they avoid changes of speed by two levels,
which neither r_env nor r_social expresses. Each method gets the experts' demonstrations for 0, 45
and 90 degrees and the reward pair. It is scored on R(α) plus comfort, also at angles without
demonstrations. All methods are solved exactly, so only the data are random.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.figure import Figure

from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.learners.shared_reward.angles import Inferred
from socialiq.plotting.rows import band, line
from socialiq.plotting.style import COLORS, figure, plain
from socialiq.types import Row
from socialiq_lab.results import Results
from socialiq_lab.study import Context, Findings, Study, counter, view_of
from socialiq_lab.tables import column, groups, matching, mean
from studies.competence.bench import Bench, Config
from studies.competence.methods import Inputs

_LOOKS = {
    "shared competence": ("#2166ac", "o"),
    "shared competence, angles inferred": ("#67a9cf", "s"),
    "prior on returns-to-go": ("#e08214", "^"),
    "prior on rewards": ("#b2abd2", "v"),
    "prior on rewards, λ by prediction": ("#542788", "P"),
    "nearest demonstrator": ("#4d9221", "*"),
    "IQ-Learn, no prior": ("#6e6e6e", "x"),
    "RL on R(α)": ("#c23b22", "D"),
}


def compute_tables(config: Config, context: Context) -> Findings:
    """Fit every method to every data set, and evaluate exactly."""
    count = counter(context.on_stage, "data sets", len(config.seeds), "data sets")
    bench = Bench.of(config)
    rows = list(bench.without_data())
    angles: list[Row] = []
    choices: list[Row] = []
    for number, seed in enumerate(config.seeds, start=1):
        inputs = Inputs.of(bench, seed)
        rows += inputs.imitation()
        rows += inputs.priors()
        more, chosen = inputs.chosen_prior()
        rows += more
        choices += chosen
        rows += inputs.shared()
        more, inferred = inputs.inferred()
        rows += more
        angles += _angle_rows(seed, inferred)
        count(number)
    tables = {"scores": rows, "pooled": _pooled(rows), "angles": angles}
    tables["choices"] = choices
    return Findings(tables, _summary(tables))


def _angle_rows(seed: int, inferred: Inferred) -> list[Row]:
    return [
        {"seed": seed, "mode": mode, "true_angle": angle, "round": number, "mean": float(mean)}
        for number, means in enumerate(inferred.path)
        for (mode, angle), mean in zip(MODES.items(), means, strict=True)
    ]


def _pooled(rows: Sequence[Row]) -> list[Row]:
    """Mean scores over seeds and over all, demonstrated and unseen angles."""
    keys = ("method", "strength", "readout")
    pooled = []
    for values, group in groups(rows, *keys).items():
        kinds = {
            "all": group,
            "demonstrated": matching(group, demonstrated=1),
            "unseen": matching(group, demonstrated=0),
        }
        pooled.append(
            dict(zip(keys, values, strict=True))
            | {f"score_{kind}": mean(some, "score") for kind, some in kinds.items()}
            | {"score_worst": min(column(group, "score"))}
            | {"skill_all": mean(group, "skill")}
        )
    return pooled


def best_strengths(pooled: Sequence[Row]) -> dict[str, Any]:
    """Return each method's strength with the best greedy score, chosen on the scores themselves."""
    by_method = groups(matching(pooled, readout="greedy"), "method")
    return {
        method: max(rows, key=lambda row: row["score_all"])["strength"]
        for (method,), rows in by_method.items()
    }


def _summary(tables: dict[str, list[Row]]) -> dict[str, Any]:
    """Pooled scores by method (with its strength) and action selection; the inferred angles."""
    methods: dict[str, Any] = {}
    for row in tables["pooled"]:
        name = row["method"] + (f", λ {row['strength']:g}" if row["strength"] != "" else "")
        entry = {key: value for key, value in row.items() if key.startswith(("score", "skill"))}
        methods.setdefault(name, {})[row["readout"]] = entry
    last = max(column(tables["angles"], "round"))
    angles = {
        mode: mean(matching(tables["angles"], mode=mode, round=last), "mean") for mode in MODES
    }
    return {"methods": methods, "inferred_angles": angles}


def draw_figures(results: Results) -> dict[str, Figure]:
    """Draw the greedy score by angle, and the inferred angles by round."""
    return {"scores": _score_figure(results), "angles": _angle_figure(results)}


def _score_figure(results: Results) -> Figure:
    drawn = figure(8.6, 4.6)
    axes = drawn.subplots()
    strengths = best_strengths(results.tables["pooled"])
    shown = {method: look for method, look in _LOOKS.items() if method in strengths}
    for method, (color, mark) in shown.items():
        rows = matching(
            results.tables["scores"], method=method, strength=strengths[method], readout="greedy"
        )
        named = f" (best λ: {strengths[method]:g})" if strengths[method] != "" else ""
        band(axes, rows, "angle", "score", color=color, marker=mark, label=method + named)
    axes.set(xlabel="angle, degrees (0, 45 and 90 are demonstrated)", ylabel="score")
    axes.set_title("1: optimal for R(α) and comfort; 0: even chances. Band: all data sets")
    axes.set_xticks(sorted(set(column(results.tables["scores"], "angle"))))
    axes.legend(frameon=False, fontsize=8)
    plain(axes)
    return drawn


def _angle_figure(results: Results) -> Figure:
    drawn = figure(6.0, 3.8)
    axes = drawn.subplots()
    rows = results.tables["angles"]
    for (mode,), of_mode in groups(rows, "mode").items():
        color, true = COLORS[mode], of_mode[0]["true_angle"]
        for seed in sorted(set(column(rows, "seed"))):
            line(axes, matching(of_mode, seed=seed), "round", "mean", color=color, alpha=0.5)
        axes.axhline(true, color=color, linestyle=":", label=f"{mode}: {true:g}°")
    axes.set(xlabel="round of expectation-maximisation", ylabel="inferred angle, degrees")
    axes.set_title("Demonstrators' angles, inferred beside what they share")
    axes.legend(loc="center left", bbox_to_anchor=(0.0, 0.72), fontsize=8)
    plain(axes)
    return drawn


STUDY = Study(
    name="competence",
    Config=Config,
    tables=compute_tables,
    figures=draw_figures,
    view=view_of("pooled"),
)
