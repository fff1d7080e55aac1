"""Figures of the study: a statement or prediction of the theory beside what was found."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure

from socialiq.plotting.style import figure, finish, line, plain, spread
from socialiq.types import Row
from socialiq_lab.results import Results
from socialiq_lab.tables import column, groups, matching

_BLUE, _RED, _GREEN, _ORANGE, _GREY = "#2166ac", "#c23b22", "#1b7837", "#e08214", "#6e6e6e"
_COLORS = {"instantaneous": _BLUE, "to_go": _RED, "advantage": _GREEN}
_NOTHING = 1e-17  # the tables' value for a difference of exactly 0
_KINDS = {"instantaneous": "instantaneous target", "to_go": "returns-to-go target"}
_PREDICTED = {
    "occupancy": ("occupancies, τ → 0", "D", "#bbbbbb", 0.3),
    "rows": ("rows, τ → 0", "s", _ORANGE, 0.3),
    "solved": ("rows, solved at τ = 1", "P", _GREY, 0.42),
    "replay": ("rows and replay, solved at τ = 1", "*", "#000000", 0.24),
}


def draw_figures(results: Results) -> dict[str, Figure]:
    """Draw all figures of the page on theory."""
    tables = results.tables
    return {
        "fixed_point": _fixed_point(tables["rewards"]),
        "primal": _primal(tables["primal"]),
        "shaping": _shaping(tables["shaping"]),
        "zero": _zero(tables["zero"]),
        "offline": _offline(tables["offline"]),
        "response": _response(tables["path"]),
        "flips": _flips(tables["flips"]),
        "training": _training(tables),
        "lengths": _lengths(tables),
    }


def _fixed_point(rows: list[Row]) -> Figure:
    """Draw the implicit reward over the prior's centre: solved, in closed form, and its bound."""
    drawn = figure(9.6, 4.2)
    for axes, (kind, title) in zip(drawn.subplots(1, 2), _KINDS.items(), strict=True):
        pairs = matching(rows, target_kind=kind)
        centres = column(pairs, "centre")
        ends = [min(centres), max(centres)]
        axes.plot(ends, ends, color=_GREY, linewidth=1, label="centre m alone")
        bound = [end + 1 / 3 for end in ends]
        axes.plot(ends, bound, ":", color=_GREY, label="m + 1/(2κ), the most that data add")
        solved = {"marker": "o", "color": _BLUE, "fillstyle": "none", "label": "solved by Newton"}
        line(axes, pairs, "centre", "solved", linestyle="none", **solved)
        closed = {"marker": "x", "color": _RED, "markersize": 4, "label": "closed form"}
        line(axes, pairs, "centre", "closed", linestyle="none", **closed)
        axes.set(xlabel="centre m(s, a) (reward)", ylabel="implicit reward r̂(s, a)")
        finish(axes, f"7x7, 0°, {title}, λ = 1, τ = 1", legend=8)
    return drawn


def _primal(rows: list[Row]) -> Figure:
    """Draw the loss of primal value against the share of another occupancy."""
    drawn = figure(9.6, 4.2)
    others = dict.fromkeys(column(rows, "other"))
    looks = zip(others, (_BLUE, _RED, _GREEN, _ORANGE), ("o", "^", "s", "D"), strict=False)
    looks = [*looks]
    for axes, (kind, title) in zip(drawn.subplots(1, 2), _KINDS.items(), strict=True):
        for other, color, mark in looks:
            path = matching(rows, target_kind=kind, other=other)
            lost = [10.0**value for value in column(path, "log10_lost")]
            style = {"marker": mark, "markersize": 4, "color": color}
            axes.loglog(column(path, "share"), lost, label=other, **style)
        axes.set(xlabel="share of the other occupancy", ylabel="primal value lost (per mass)")
        finish(axes, f"7x7, 0°, {title}, λ = 1, τ = 1")
        axes.legend(title="mixed in", frameon=False, fontsize=8)
    return drawn


def _shaping(rows: list[Row]) -> Figure:
    """Draw the change of the policy of instantaneous targets under others, a mark for each case."""
    drawn = figure(7.6, 4.0)
    axes = drawn.subplots()
    names = {
        "random shaping": "random\nshaping",
        "advantage": "advantage of\nthe pool",
        "own_advantage": "own advantage\nof each expert",
        "to_go": "returns-to-go",
    }
    for place, name in enumerate(names):
        changes = [10.0**value for value in column(matching(rows, change=name), "log10_difference")]
        last = max(len(changes) - 1, 1)
        places = [place + 0.3 * (number / last - 0.5) for number in range(len(changes))]
        color = _BLUE if max(changes) < 1e-6 else _RED
        axes.semilogy(places, changes, "o", color=color, alpha=0.6, markersize=5)
    axes.set_xticks(range(len(names)), list(names.values()))
    axes.set_ylim(_NOTHING / 3, 3.0)
    axes.set(ylabel="largest change of an action's probability")
    finish(axes, "target in place of the instantaneous reward; λ = 1, τ = 1")
    return drawn


def _zero(rows: list[Row]) -> Figure:
    """Draw the distance of λ = 0 from the baseline, and from the baseline of another α_χ."""
    drawn = figure(7.6, 3.8)
    axes = drawn.subplots()
    columns = {
        "log10_from_baseline": ("baseline, α_χ = 1/2", _RED, "o"),
        "log10_from_baseline_sixth": ("baseline, α_χ = 1/6", _BLUE, "s"),
    }
    for name, (label, color, mark) in columns.items():
        values = [10.0**value for value in column(rows, name)]
        axes.semilogy(range(len(rows)), values, mark, color=color, label=label)
    axes.set_xticks(range(len(rows)), [name.replace(" ", "\n") for name in column(rows, "world")])
    axes.set_ylim(_NOTHING / 3, 3.0)
    axes.set(ylabel="largest difference of a probability")
    axes.legend(frameon=False, fontsize=8, loc="center right")
    finish(axes, "policy at λ = 0, w = 1, beside that of (drawn at 1e-17: equal)")
    return drawn


def _offline(rows: list[Row]) -> Figure:
    """Draw the objective against conservative Q-learning's loss, at random tables Q."""
    drawn = figure(4.6, 4.2)
    axes = drawn.subplots()
    losses = column(rows, "loss")
    ends = [min(losses), max(losses)]
    axes.loglog(ends, ends, color=_GREY, linewidth=1, label="equal")
    style = {"color": _BLUE, "fillstyle": "none", "markersize": 4}
    axes.loglog(column(rows, "conservative"), losses, "o", label="random Q", **style)
    axes.set(xlabel="conservative Q-learning + constant", ylabel="the objective (Eq 4.5)")
    finish(axes, "losses, reward squared", legend=8)
    return drawn


def _response(rows: list[Row]) -> Figure:
    """Draw the mean target along λ: the straight line, and the exact path at three temperatures."""
    drawn = figure(9.6, 4.2)
    for axes, (kind, title) in zip(drawn.subplots(1, 2), _KINDS.items(), strict=True):
        of_kind = matching(rows, target_kind=kind)
        temperatures = sorted(set(column(of_kind, "temperature")))
        looks = zip(temperatures, (_BLUE, _GREEN, _ORANGE), ("o", "s", "^"), strict=False)
        for temperature, color, mark in looks:
            path = matching(of_kind, temperature=temperature)
            style = {"marker": mark, "markersize": 4, "linewidth": 1, "color": color}
            label = f"exact, τ = {temperature:g}"
            line(axes, path, "strength", "mean_target", label=label, **style)
        straight = matching(of_kind, temperature=temperatures[0])
        style = {"linestyle": "--", "color": _RED, "label": "line of slope 2 w ‖T_⊥‖²"}
        line(axes, straight, "strength", "line", **style)
        reach = {"color": _GREY, "linestyle": ":", "label": "reach of the line"}
        axes.axvline(of_kind[0]["reach"], **reach)
        axes.set(xlabel="λ", ylabel="mean target E_ρ[T̄] (reward, per mass)")
        finish(axes, f"7x7, 0°, {title}", legend=8)
    return drawn


def _flips(rows: list[Row]) -> Figure:
    """Draw λ of every flip, predicted against found near τ = 0; misses at the edges."""
    drawn = figure(10.4, 5.0)
    titles = {"online": "gradient through V(s')", "target": "V(s') of a slow copy"}
    rows = matching(rows, tie=0)
    values = [row[name] for row in rows for name in ("predicted", "found") if row[name] != ""]
    low, high = min(values) / 1.5, max(values) * 2.5
    for axes, (way, title) in zip(drawn.subplots(1, 2), titles.items(), strict=True):
        flips = matching(rows, next_value=way)
        predicted = [row for row in flips if row["predicted"] != ""]
        both = [row for row in predicted if row["found"] != ""]
        missing = column(matching(predicted, found=""), "predicted")
        unpredicted = [row["found"] for row in matching(flips, predicted="") if row["found"] != ""]
        axes.fill_between(
            [low, high], [low / 1.15, high / 1.15], [low / 0.85, high / 0.85], color="#dddddd"
        )
        for within, reach, style in ((1, "within", "full"), (0, "beyond", "none")):
            points = matching(both, within_reach=within)
            look = {"color": _BLUE, "fillstyle": style, "markersize": 4.5, "linestyle": "none"}
            label = f"{reach} the lines' reach ({len(points)})"
            line(axes, points, "predicted", "found", marker="o", label=label, **look)
        edge = high / 1.2
        axes.plot(missing, [edge] * len(missing), "^", color=_RED, markersize=5)
        axes.plot([edge] * len(unpredicted), unpredicted, ">", color=_ORANGE, markersize=5)
        axes.plot([], [], "^", color=_RED, label=f"predicted, not found ({len(missing)})")
        axes.plot([], [], ">", color=_ORANGE, label=f"found, not predicted ({len(unpredicted)})")
        axes.set(xscale="log", yscale="log", xlim=(low, high), ylim=(low, high))
        axes.set(xlabel="predicted λ", ylabel="found λ")
        axes.legend(frameon=False, fontsize=8, loc="upper left")
        finish(axes, f"{title} (grey: within 15 %)")
    return drawn


def _training(tables: dict[str, list[Row]]) -> Figure:
    """Draw the predicted λ and each seed's interval of the grid, for each gradient and target."""
    ways = {"online": "gradient through V(s')", "target": "slow copy"}
    firsts = groups(tables["first_flips"], "next_value", "target_kind")
    drawn = figure(9.6, 1.4 + 0.85 * len(firsts))
    axes = drawn.subplots()
    for place, ((way, kind), seeds) in enumerate(firsts.items()):
        predicted = matching(tables["predicted"], next_value=way, target_kind=kind)[0]
        for name, (label, mark, color, above) in _PREDICTED.items():
            style = {"color": color, "markersize": 10 if mark == "*" else 6}
            label = label if place == 0 else None
            axes.plot([predicted[name]], [place - above], mark, label=label, **style)
        _draw_intervals(axes, seeds, place, _COLORS[kind])
    axes.set_xscale("log")
    axes.set_yticks(range(len(firsts)), [f"{kind}\n{ways[way]}" for way, kind in firsts])
    axes.invert_yaxis()
    axes.set(xlabel="λ of the first flip of the greedy policy")
    axes.legend(frameon=False, fontsize=8, loc="upper left")
    title = "7x7, 0°, τ = 1: predicted (marks), and the grid's step in which each seed left (bars)"
    finish(axes, title)
    return drawn


def _draw_intervals(axes: Any, seeds: list[Row], place: int, color: str) -> None:
    """Draw a bar for each seed, from the last λ with the baseline's choices to the next one."""
    for number, row in enumerate(seeds):
        if row["first"] != "":
            height = place + 0.5 * number / max(len(seeds) - 1, 1) - 0.1
            below = row["below"] if row["below"] not in ("", 0.0) else row["first"] / 1.5
            axes.plot([below, row["first"]], [height] * 2, "|-", color=color, linewidth=2)


def _lengths(tables: dict[str, list[Row]]) -> Figure:
    """Draw the expected steps of an episode along λ; exact, and trained networks at 0 degrees."""
    angles = groups(tables["lengths"], "angle")
    temperatures = sorted(set(column(tables["lengths"], "temperature")), reverse=True)
    drawn = figure(4.0 * len(angles), 4.2)
    panels = drawn.subplots(1, len(angles), sharey=True, squeeze=False)[0]
    for axes, ((angle,), rows) in zip(panels, sorted(angles.items()), strict=True):
        for kind in _KINDS:
            for temperature, dashes in zip(temperatures, ("-", "--"), strict=False):
                path = matching(rows, target_kind=kind, temperature=temperature)
                style = {"linestyle": dashes, "marker": ".", "color": _COLORS[kind]}
                label = f"{kind}, τ = {temperature:g}"
                line(axes, path, "strength", "soft_length", label=label, **style)
        axes.axhline(rows[0]["optimum_length"], color=_GREY, linestyle=":", label="optimum")
        if angle == 0.0:
            _draw_networks(axes, tables["trained"])
        axes.set_xscale("symlog", linthresh=0.1, linscale=0.4)
        axes.set_xlim(-0.02, 1.25 * max(column(rows, "strength")))
        axes.set_xticks([0, 0.1, 1, 10], ["0", "0.1", "1", "10"])
        axes.set(xlabel="λ", title=f"{angle:g}°")
        axes.title.set_fontsize(10)
        plain(axes)
    panels[0].set(ylabel="steps of an episode (soft policy)")
    panels[0].legend(frameon=False, fontsize=7)
    return drawn


def _draw_networks(axes: Any, rows: list[Row]) -> None:
    """Draw means over seeds of networks with the gradient through V(s')."""
    for kind in _KINDS:
        runs = matching(rows, next_value="online", target_kind=kind)
        runs = [row for row in runs if row["prior_weight"] > 0.0]
        strengths, means, _, _ = spread(runs, "strength", "soft_length")
        label = f"{kind}, networks, τ = 1"
        axes.plot(strengths, means, "x", color=_COLORS[kind], label=label)
