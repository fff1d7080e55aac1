"""Coverage of the audit's intervals and error rates of its verdicts, on simulated drivers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from socialiq.audit.evidence.outcomes import FEWEST_EPISODES
from socialiq.errors import UserError
from socialiq.plotting.style import figure, head, plain
from socialiq.types import Row
from socialiq_lab.results import Results
from socialiq_lab.study import Context, Findings, Study, counter, view_of
from socialiq_lab.tables import column
from studies.audit_power.grinding import POLICIES, TRIES, grinding_rows
from studies.audit_power.heavy_tails import (
    SIZES,
    TAILS,
    TIMES,
    error_rows,
    false_bound_rows,
    long_audit_rows,
    price_rows,
)
from studies.audit_power.power import ERROR, coverage_rows, verdict_rows

_COLORS = {"passed": "#1b7837", "inconclusive": "#bdbdbd", "failed": "#c23b22"}


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    episodes: int = 500
    """Episodes of an audit."""
    replications: int = 2000
    """Audits of each population."""
    resamples: int = 1000
    """Resamples of each bootstrap."""
    owners: int = 4000
    """Owners of each policy who try up to 20 times."""
    first_seed: int = 100_000
    """Seed of the first audit; the others follow. Seeds below 10,000 were for development."""

    def __post_init__(self) -> None:
        """Refuse numbers that are too small for an audit."""
        least_of = {"episodes": FEWEST_EPISODES, "replications": 1, "resamples": 2, "owners": 1}
        for name, least in least_of.items():
            if getattr(self, name) < least:
                raise UserError(f"{name} must be at least {least}, got {getattr(self, name)}")


def compute_tables(config: Config, context: Context) -> Findings:
    """Audit simulated drivers many times, and count."""
    sizes = config.episodes, config.replications, config.first_seed, config.resamples
    count = partial(counter, context.on_stage, total=config.replications, unit="audits")
    tables = {
        "coverage": coverage_rows(*sizes, on_progress=count("coverage")),
        "verdicts": verdict_rows(*sizes, on_progress=count("error rates")),
        "grinding": _grinding(config, context),
        **_heavy_tails(config, context),
    }
    return Findings(tables, _summary(tables))


def _grinding(config: Config, context: Context) -> list[Row]:
    """Count the owners who pass by trying again."""
    on_progress = counter(context.on_stage, "grinding", config.owners, "owners")
    sizes = config.episodes, config.owners, config.first_seed, config.resamples
    return grinding_rows(*sizes, on_progress=on_progress)


def _heavy_tails(config: Config, context: Context) -> dict[str, list[Row]]:
    """Count wrong passes of policies with rare large losses, and passes of good ones."""

    def cases(stage: str, total: int) -> Any:
        return counter(context.on_stage, stage, total=total, unit="cases")

    sizes = config.episodes, config.replications, config.first_seed
    audits = max(1, config.replications // 8)
    wrong, price = len(TAILS) * len(TIMES), len(TAILS) * len(SIZES)
    return {
        "heavy_tails": error_rows(*sizes, config.resamples, cases("heavy tails", wrong)),
        "long_audits": long_audit_rows(*sizes),
        "false_bounds": false_bound_rows(*sizes),
        "price": price_rows(audits, config.first_seed, config.resamples, cases("price", price)),
    }


def _summary(tables: dict[str, list[Row]]) -> dict[str, Any]:
    """Rows by name, and the largest deviation of an exact interval from its nominal coverage."""
    off = [abs(row["covered"] - row["nominal"]) for row in tables["coverage"] if row["exact"]]
    return {
        "coverage": {row["interval"]: row for row in tables["coverage"]},
        "verdicts": {row["case"]: row for row in tables["verdicts"]},
        "farthest_off": max(off),
        "grinding": {
            f"{row['policy']}, {row['way']}": row
            for row in tables["grinding"]
            if row["tries"] == TRIES
        },
        "heavy_tails": {f"{row['losses']}, {row['regret']}": row for row in tables["heavy_tails"]},
        "long_audits": {row["losses"]: row for row in tables["long_audits"]},
        "false_bounds": {row["losses"]: row for row in tables["false_bounds"]},
        "price": {f"{row['losses']}, {row['episodes']}": row for row in tables["price"]},
    }


def draw_figures(results: Results) -> dict[str, Figure]:
    """Draw the figures of the study."""
    return {
        "coverage": _coverage_figure(results),
        "verdicts": _verdict_figure(results),
        "grinding": _grinding_figure(results),
        "heavy_tails": _tails_figure(results),
    }


def _coverage_figure(results: Results) -> Figure:
    """Draw the coverage of each interval less its nominal level, with 99 % intervals."""
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
    axes.set_xlabel("percentage points above the nominal coverage")
    audits, episodes = results.config["replications"], results.config["episodes"]
    title = f"{audits:,} audits of {episodes} episodes (grey: within 2 points; open: may be above)"
    head(drawn, title)
    plain(axes)
    return drawn


def _verdict_figure(results: Results) -> Figure:
    """Draw the shares of verdicts on policies with known true values."""
    rows = results.tables["verdicts"]
    drawn = figure(8.6, 3.6)
    axes = drawn.subplots()
    left = [0.0] * len(rows)
    for kind, color in _COLORS.items():
        widths = [100 * row[kind] for row in rows]
        bars = axes.barh(column(rows, "case"), widths, left=left, color=color, label=kind)
        labels = [f"{width:.1f}" if width >= 4 else "" for width in widths]
        axes.bar_label(bars, labels, label_type="center", fontsize=8)
        left = [a + b for a, b in zip(left, widths, strict=True)]
    axes.set(xlabel="% of audits", xlim=(0, 100))
    axes.invert_yaxis()
    audits, episodes = results.config["replications"], results.config["episodes"]
    head(drawn, f"{audits:,} audits of {episodes} episodes for each case", axes)
    return drawn


def _grinding_figure(results: Results) -> Figure:
    """Draw the share of owners who have passed wrongly after a number of tries, by way."""
    policy = next(iter(POLICIES))
    drawn = figure(8.6, 4.0)
    axes = drawn.subplots()
    axes.axhline(100 * ERROR, color="#444444", linewidth=0.8)
    for way, style in _STYLES.items():
        rows = [
            row
            for row in results.tables["grinding"]
            if (row["policy"], row["way"]) == (policy, way)
        ]
        shares = [[100 * row[name] for row in rows] for name in ("passed", "low", "high")]
        tries = column(rows, "tries")
        axes.plot(tries, shares[0], label=way, **style)
        axes.fill_between(
            tries, shares[1], shares[2], color=style["color"], alpha=0.12, linewidth=0
        )
    axes.set(xlabel="tries", ylabel="% of owners with a wrong pass", ylim=(0, None))
    axes.set_xticks(sorted({row["tries"] for row in results.tables["grinding"]}))
    plain(axes)
    owners = results.config["owners"]
    head(drawn, f"{owners:,} owners whose regret is {policy} (line: {100 * ERROR:g} %)", axes)
    return drawn


_STYLES: dict[str, dict[str, Any]] = {
    way: {"color": "#1b7837" if closed else "#c23b22", "linestyle": line, "marker": "o"}
    for way, closed, line in (
        ("free byte, announced seed, no log", False, ":"),
        ("owner's seeds, no log", False, "--"),
        ("rerun, no log", False, "-"),
        ("free byte, announced seed, log", False, "-."),
        ("owner's seeds, log", True, "--"),
        ("free byte, nonce, log", True, ":"),
        ("rerun, log", True, "-"),
    )
}
"""Lines of the ways: red where an owner can grind."""


_BOUNDS = {"bootstrap": "#c23b22", "betting": "#2166ac"}


def _tails_figure(results: Results) -> Figure:
    """Draw wrong passes of both bounds, and the passes of good policies by number of episodes."""
    drawn = figure(10.4, 4.0)
    wrong, price = drawn.subplots(1, 2)
    rows = [row for row in results.tables["heavy_tails"] if row["margins"] >= 1.0]
    for shift, (kind, color) in zip((-0.15, 0.15), _BOUNDS.items(), strict=True):
        for place, row in enumerate(rows):
            ends = [100 * row[f"{kind}_low"], 100 * row[f"{kind}_high"]]
            wrong.plot(ends, [place + shift] * 2, color=color, linewidth=1)
        shares = [100 * row[kind] for row in rows]
        wrong.plot(shares, np.arange(len(rows)) + shift, "o", color=color, label=kind)
    wrong.axvline(5, color="#444444", linewidth=0.8)
    wrong.set_yticks(range(len(rows)), [f"{row['losses']}, {row['regret']}" for row in rows])
    wrong.set(xlabel="% of audits that pass wrongly (line: 5 %)")
    wrong.invert_yaxis()
    wrong.legend(loc="lower right", frameon=False)
    styles = ("-", "--", "-.", ":")
    for name, style in zip(dict.fromkeys(column(rows, "losses")), styles, strict=True):
        good = [row for row in results.tables["price"] if row["losses"] == name]
        for kind, color in _BOUNDS.items():
            shares = [100 * row[kind] for row in good]
            label = name if kind == "betting" else None
            price.plot(column(good, "episodes"), shares, style, color=color, label=label)
    price.set(xscale="log", xlabel="episodes", ylabel="% that pass, regret 0.2 margins")
    price.set_xticks(SIZES, [f"{size:,}" for size in SIZES])
    price.minorticks_off()
    price.legend(frameon=False, fontsize=8, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
    for axes in (wrong, price):
        plain(axes)
    return drawn


STUDY = Study(
    name="audit-power",
    Config=Config,
    tables=compute_tables,
    figures=draw_figures,
    view=view_of("verdicts"),
)
