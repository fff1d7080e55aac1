"""The intersection as the thesis draws it (Fig 5.3), an episode, and outcomes by driver."""

from __future__ import annotations

from matplotlib.figure import Figure

from socialiq.experiments.intersection.plots import OUTCOME_COLORS
from socialiq.experiments.results import Results
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.pictures.render import filmstrip, picture
from socialiq.worlds.intersection.pictures.scenes import episode_scenes
from socialiq.worlds.intersection.policies import policy

EPISODE_SEED = 3
DRIVERS = ("go", "random", "gap_2s", "gap_3s", "gap_4s", "stop_line", "wait")


def draw(results: Results) -> dict[str, Figure]:
    """Figures by name."""
    options = Options()
    scenes = episode_scenes(options, policy("gap_3s"), EPISODE_SEED)
    decisions = scenes[:: options.frames]
    return {
        "fig_5_3": picture(scenes[4 * options.frames]),
        "gap_3s_episode": filmstrip(decisions[:10]),
        "outcomes": _outcomes(results),
    }


def _outcomes(results: Results) -> Figure:
    """Stacked shares of the endings, by driver and population."""
    figure = Figure(figsize=(8.0, 3.2), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for axes, population in zip(panels, ("highway_env", "thesis"), strict=True):
        rows = {
            row["driver"]: row
            for row in results.tables["outcomes"]
            if row["population"] == population
        }
        left = dict.fromkeys(DRIVERS, 0.0)
        for outcome, color in OUTCOME_COLORS.items():
            widths = [100 * rows[driver][outcome] for driver in DRIVERS]
            bars = axes.barh(DRIVERS, widths, left=list(left.values()), color=color, label=outcome)
            axes.bar_label(
                bars,
                [f"{w:.0f}" if w >= 4 else "" for w in widths],
                label_type="center",
                fontsize=8,
            )
            left = {d: left[d] + w for d, w in zip(DRIVERS, widths, strict=True)}
        axes.set(title=f"population {population}", xlabel="% of episodes", xlim=(0, 100))
        axes.invert_yaxis() if axes is panels[0] else None
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure
