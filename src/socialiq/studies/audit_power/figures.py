"""Coverage of the audit's intervals beside what they promise, and its verdicts by case."""

from __future__ import annotations

from matplotlib.figure import Figure

from socialiq.experiments.results import Results
from socialiq.plotting.style import figure, plain

_COLORS = {"passed": "#1b7837", "inconclusive": "#bdbdbd", "failed": "#c23b22"}


def draw(results: Results) -> dict[str, Figure]:
    """Both figures of the study."""
    return {"coverage": coverage(results), "verdicts": verdicts(results)}


def coverage(results: Results) -> Figure:
    """Coverage of each interval less its nominal level, with 99 % intervals."""
    rows = results.tables["coverage"]
    drawn = figure(8.6, 4.4)
    axes = drawn.subplots()
    axes.axvspan(-2, 2, color="#eeeeee")
    axes.axvline(0, color="#444444", linewidth=0.8)
    for place, row in enumerate(rows):
        low, mean, high = (100 * (row[n] - row["nominal"]) for n in ("low", "covered", "high"))
        face = "#2166ac" if row["exact"] else "white"
        axes.plot([low, high], [place] * 2, color="#2166ac", linewidth=1)
        axes.plot([mean], [place], "o", color="#2166ac", markerfacecolor=face, markersize=6)
    names = [f"{row['interval']} ({100 * row['nominal']:.4g} %)" for row in rows]
    axes.set_yticks(range(len(rows)), names)
    axes.invert_yaxis()
    axes.set_xlabel("percentage points above what is promised")
    audits, episodes = results.config["replications"], results.config["episodes"]
    title = f"{audits:,} audits of {episodes} episodes (grey: within 2 points; open: may be above)"
    drawn.suptitle(title, fontsize=10)
    plain(axes)
    return drawn


def verdicts(results: Results) -> Figure:
    """Shares of verdicts on policies of which the truth is known."""
    rows = results.tables["verdicts"]
    drawn = figure(8.6, 3.6)
    axes = drawn.subplots()
    left = [0.0] * len(rows)
    for kind, color in _COLORS.items():
        widths = [100 * row[kind] for row in rows]
        bars = axes.barh([row["case"] for row in rows], widths, left=left, color=color, label=kind)
        shown = [f"{width:.1f}" if width >= 4 else "" for width in widths]
        axes.bar_label(bars, shown, label_type="center", fontsize=8)
        left = [a + b for a, b in zip(left, widths, strict=True)]
    axes.set(xlabel="% of audits", xlim=(0, 100))
    axes.invert_yaxis()
    drawn.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    audits, episodes = results.config["replications"], results.config["episodes"]
    drawn.suptitle(f"{audits:,} audits of {episodes} episodes for each case", fontsize=10)
    return drawn
