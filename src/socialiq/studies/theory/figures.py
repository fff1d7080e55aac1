"""One figure for each statement of the theory: the closed form beside what was found."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure

from socialiq.experiments.results import Results
from socialiq.plotting.style import figure, plain
from socialiq.studies.theory.figures_training import lengths, training
from socialiq.types import Row

_BLUE, _RED, _GREEN, _ORANGE, _GREY = "#2166ac", "#c23b22", "#1b7837", "#e08214", "#6e6e6e"
_NOTHING = 1e-17  # where a difference of exactly 0 stands in the tables
KINDS = {"instantaneous": "instantaneous target", "to_go": "returns-to-go target"}


def draw(results: Results) -> dict[str, Figure]:
    """All figures of the page on theory."""
    tables = results.tables
    return {
        "fixed_point": fixed_point(tables["rewards"]),
        "primal": primal(tables["primal"]),
        "shaping": shaping(tables["shaping"]),
        "zero": zero(tables["zero"]),
        "offline": offline(tables["offline"]),
        "response": response(tables["path"]),
        "flips": flips(tables["flips"]),
        "training": training(tables),
        "lengths": lengths(tables),
    }


def fixed_point(rows: list[Row]) -> Figure:
    """The implicit reward over the prior's centre: solved, in closed form, and its bound."""
    drawn = figure(9.6, 4.2)
    for axes, (kind, title) in zip(drawn.subplots(1, 2), KINDS.items(), strict=True):
        here = [row for row in rows if row["target_kind"] == kind]
        middle = [row["centre"] for row in here]
        ends = [min(middle), max(middle)]
        axes.plot(ends, ends, color=_GREY, linewidth=1, label="centre m alone")
        bound = [end + 1 / 3 for end in ends]
        axes.plot(ends, bound, ":", color=_GREY, label="m + 1/(2κ), the most that data add")
        solved = [row["solved"] for row in here]
        axes.plot(middle, solved, "o", color=_BLUE, fillstyle="none", label="solved by Newton")
        closed = [row["closed"] for row in here]
        axes.plot(middle, closed, "x", color=_RED, markersize=4, label="closed form")
        axes.set(xlabel="centre m(s, a) (reward)", ylabel="implicit reward r̂(s, a)")
        axes.set_title(f"7x7, 0°, {title}, λ = 1, τ = 1", fontsize=10)
        axes.legend(frameon=False, fontsize=8)
        plain(axes)
    return drawn


def primal(rows: list[Row]) -> Figure:
    """Primal value lost against the share of another occupancy that is mixed in."""
    drawn = figure(9.6, 4.2)
    others = list(dict.fromkeys(row["other"] for row in rows))
    looks = zip(others, (_BLUE, _RED, _GREEN, _ORANGE), ("o", "^", "s", "D"), strict=False)
    looks = [*looks]
    for axes, (kind, title) in zip(drawn.subplots(1, 2), KINDS.items(), strict=True):
        for other, color, mark in looks:
            here = [r for r in rows if (r["target_kind"], r["other"]) == (kind, other)]
            axes.loglog(
                [row["share"] for row in here],
                [10.0 ** row["log10_lost"] for row in here],
                marker=mark,
                markersize=4,
                color=color,
                label=other,
            )
        axes.set(xlabel="share of the other occupancy", ylabel="primal value lost (per mass)")
        axes.set_title(f"7x7, 0°, {title}, λ = 1, τ = 1", fontsize=10)
        plain(axes)
        axes.legend(title="mixed in", frameon=False, fontsize=8)
    return drawn


def shaping(rows: list[Row]) -> Figure:
    """Change of the policy of instantaneous targets under other targets, a mark for each case."""
    drawn = figure(7.6, 4.0)
    axes = drawn.subplots()
    names = {
        "random shaping": "random\nshaping",
        "advantage": "advantage of\nthe pool",
        "own_advantage": "own advantage\nof each expert",
        "to_go": "returns-to-go",
    }
    for place, name in enumerate(names):
        here = [10.0 ** r["log10_difference"] for r in rows if r["change"] == name]
        spread = [
            place + 0.3 * (number / max(len(here) - 1, 1) - 0.5) for number in range(len(here))
        ]
        color = _BLUE if max(here) < 1e-6 else _RED
        axes.semilogy(spread, here, "o", color=color, alpha=0.6, markersize=5)
    axes.set_xticks(range(len(names)), list(names.values()))
    axes.set_ylim(_NOTHING / 3, 3.0)
    axes.set(ylabel="largest change of an action's probability")
    axes.set_title("target in place of the instantaneous reward; λ = 1, τ = 1", fontsize=10)
    plain(axes)
    return drawn


def zero(rows: list[Row]) -> Figure:
    """Distance of λ = 0 from the baseline, and from the baseline of another α_χ."""
    drawn = figure(7.6, 3.8)
    axes = drawn.subplots()
    columns = {
        "log10_from_baseline": ("baseline, α_χ = 1/2", _RED, "o"),
        "log10_from_baseline_sixth": ("baseline, α_χ = 1/6", _BLUE, "s"),
    }
    for column, (label, color, mark) in columns.items():
        values = [10.0 ** row[column] for row in rows]
        axes.semilogy(range(len(rows)), values, mark, color=color, label=label)
    axes.set_xticks(range(len(rows)), [str(row["world"]).replace(" ", "\n") for row in rows])
    axes.set_ylim(_NOTHING / 3, 3.0)
    axes.set(ylabel="largest difference of a probability")
    axes.set_title("policy at λ = 0, w = 1, beside that of (drawn at 1e-17: equal)", fontsize=10)
    axes.legend(frameon=False, fontsize=8, loc="center right")
    plain(axes)
    return drawn


def offline(rows: list[Row]) -> Figure:
    """The objective against conservative Q-learning's loss, at random tables Q."""
    drawn = figure(4.6, 4.2)
    axes = drawn.subplots()
    ends = [min(row["loss"] for row in rows), max(row["loss"] for row in rows)]
    axes.loglog(ends, ends, color=_GREY, linewidth=1, label="equal")
    axes.loglog(
        [row["conservative"] for row in rows],
        [row["loss"] for row in rows],
        "o",
        color=_BLUE,
        fillstyle="none",
        markersize=4,
        label="random Q",
    )
    axes.set(xlabel="conservative Q-learning + constant", ylabel="the objective (Eq 4.5)")
    axes.set_title("losses, reward squared", fontsize=10)
    axes.legend(frameon=False, fontsize=8)
    plain(axes)
    return drawn


def response(rows: list[Row]) -> Figure:
    """The mean target along λ: the straight line, and the exact path at three temperatures."""
    drawn = figure(9.6, 4.2)
    for axes, (kind, title) in zip(drawn.subplots(1, 2), KINDS.items(), strict=True):
        here = [row for row in rows if row["target_kind"] == kind]
        temperatures = sorted({row["temperature"] for row in here})
        looks = zip(temperatures, (_BLUE, _GREEN, _ORANGE), ("o", "s", "^"), strict=False)
        for temperature, color, mark in looks:
            path = [row for row in here if row["temperature"] == temperature]
            axes.plot(
                [row["strength"] for row in path],
                [row["mean_target"] for row in path],
                marker=mark,
                markersize=4,
                linewidth=1,
                color=color,
                label=f"exact, τ = {temperature:g}",
            )
        line = [row for row in here if row["temperature"] == temperatures[0]]
        axes.plot(
            [row["strength"] for row in line],
            [row["line"] for row in line],
            "--",
            color=_RED,
            label="line of slope 2 w ‖T_⊥‖²",
        )
        axes.axvline(here[0]["reach"], color=_GREY, linestyle=":", label="reach of the line")
        axes.set(xlabel="λ", ylabel="mean target E_ρ[T̄] (reward, per mass)")
        axes.set_title(f"7x7, 0°, {title}", fontsize=10)
        axes.legend(frameon=False, fontsize=8)
        plain(axes)
    return drawn


def flips(rows: list[Row]) -> Figure:
    """Every flip: λ predicted against λ found near τ = 0, misses at the edges."""
    drawn = figure(10.4, 5.0)
    titles = {"online": "gradient through V(s')", "target": "V(s') of a slow copy"}
    told = [row for row in rows if not row["tie"]]
    values = [row[name] for row in told for name in ("predicted", "found") if row[name] != ""]
    low, high = min(values) / 1.5, max(values) * 2.5
    for axes, (way, title) in zip(drawn.subplots(1, 2), titles.items(), strict=True):
        here = [row for row in told if row["next_value"] == way]
        axes.fill_between(
            [low, high], [low / 1.15, high / 1.15], [low / 0.85, high / 0.85], color="#dddddd"
        )
        for within, style in ((1, "full"), (0, "none")):
            both = [
                row
                for row in here
                if row["predicted"] != "" and row["found"] != "" and row["within_reach"] == within
            ]
            _points(axes, both, style, "within" if within else "beyond")
        missing = [
            row["predicted"] for row in here if row["predicted"] != "" and row["found"] == ""
        ]
        axes.plot(missing, [high / 1.2] * len(missing), "^", color=_RED, markersize=5)
        unseen = [row["found"] for row in here if row["predicted"] == "" and row["found"] != ""]
        axes.plot([high / 1.2] * len(unseen), unseen, ">", color=_ORANGE, markersize=5)
        axes.plot([], [], "^", color=_RED, label=f"predicted, not found ({len(missing)})")
        axes.plot([], [], ">", color=_ORANGE, label=f"found, not predicted ({len(unseen)})")
        axes.set(xscale="log", yscale="log", xlim=(low, high), ylim=(low, high))
        axes.set(xlabel="predicted λ", ylabel="found λ")
        axes.set_title(f"{title} (grey: within 15 %)", fontsize=10)
        axes.legend(frameon=False, fontsize=8, loc="upper left")
        plain(axes)
    return drawn


def _points(axes: Any, rows: list[Row], style: Any, reach: str) -> None:
    axes.plot(
        [row["predicted"] for row in rows],
        [row["found"] for row in rows],
        "o",
        color=_BLUE,
        fillstyle=style,
        markersize=4.5,
        label=f"{reach} the lines' reach ({len(rows)})",
    )
