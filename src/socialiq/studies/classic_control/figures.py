"""Mean return of each training seed, beside the expert's."""

from __future__ import annotations

from matplotlib.figure import Figure

from socialiq.experiments.results import Results
from socialiq.plotting.style import figure, plain

_COLORS = {"iq_learn": "#2166ac", "behaviour_cloning": "#e08214"}


def draw(results: Results) -> dict[str, Figure]:
    """One panel for each task; a dot for each seed."""
    rows = results.tables["returns"]
    tasks = list(dict.fromkeys(row["task"] for row in rows))
    drawn = figure(3.6 * len(tasks), 3.4)
    for axes, task in zip(drawn.subplots(1, len(tasks), squeeze=False)[0], tasks, strict=True):
        here = [row for row in rows if row["task"] == task]
        for place, (learner, color) in enumerate(_COLORS.items()):
            returns = [row["mean_return"] for row in here if row["learner"] == learner]
            axes.plot([place] * len(returns), returns, "o", color=color, alpha=0.7)
        axes.axhline(here[0]["expert_return"], color="#999999", linestyle=":", label="expert")
        axes.set_xticks([0, 1], ["IQ-Learn", "cloning"])
        axes.set_xlim(-0.5, 1.5)
        axes.set_title(f"{task} ({here[0]['transitions']} transitions)", fontsize=9)
        axes.set_ylabel("mean return")
        plain(axes)
    return {"returns": drawn}
