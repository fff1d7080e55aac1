"""The thesis' tables with our numbers beside its own, from the rows of policies."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.demonstrations import files
from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.evaluation.front import support_intervals
from socialiq.evaluation.play import Episodes
from socialiq.experiments.intersection import thesis_values
from socialiq.experiments.intersection.experts import expert_name
from socialiq.experiments.intersection.rows import Played, outcome_row
from socialiq.statistics.comparisons import cohens_d
from socialiq.storage import load_arrays
from socialiq.studies.intersection.config import Config
from socialiq.studies.intersection.plan import TARGETS, TRAINED, learner_name
from socialiq.types import Row

PERCENT = ("collision", "arrival", "timeout", "stopped")
READOUTS = ("greedy", "soft")

ByName = Mapping[tuple[str, str], Row]
"""Rows of policies by (policy, readout)."""


def table_6_2(rows: ByName, plays: Mapping[tuple[str, str], Played], config: Config) -> list[Row]:
    """Tables 6.1 and 6.2: each metric of experts and learners beside the thesis' value.

    `over_training` is the standard deviation over training seeds, empty for a single expert;
    `over_evaluation` that over groups of evaluation episodes, averaged over training seeds.
    """
    found: list[Row] = []
    for group, metric in itertools.product(_groups(), thesis_values.METRICS):
        for readout in READOUTS:
            for policy, names in _columns(group, config).items():
                if any((name, readout) not in rows for name in names):
                    continue  # experts are read greedily
                factor = 100 if metric in PERCENT else 1
                values = [factor * rows[name, readout][metric] for name in names]
                spreads = [
                    factor * group_spread(plays[name, readout].episodes, config)[metric]
                    for name in names
                ]
                mean, spread = thesis_values.TABLE_6_2[metric][policy]
                found.append(
                    dict(zip(("preset", "setting"), group, strict=True))
                    | {"readout": readout, "policy": policy, "metric": metric}
                    | {"thesis": mean, "thesis_spread": spread, "ours": float(np.mean(values))}
                    | {"over_training": _sd(values), "over_evaluation": float(np.mean(spreads))}
                    | {"low": min(values), "high": max(values), "seeds": len(values)}
                )
    return found


def _groups() -> list[tuple[str, str]]:
    return [("experts", "flat"), *TRAINED]


def _columns(group: tuple[str, str], config: Config) -> dict[str, list[str]]:
    """Names of the policies behind each column of Table 6.2."""
    first, second = group
    if first == "experts":
        seed = config.expert_seed
        return {f"expert {mode}": [expert_name(second, mode, seed)] for mode in MODES}
    return {
        target: [learner_name(first, second, target, seed) for seed in config.seeds]
        for target in TARGETS
    }


def _sd(values: Sequence[float]) -> float | str:
    return float(np.std(values, ddof=1)) if len(values) > 1 else ""


def separability(pools: Path) -> tuple[list[Row], list[Row]]:
    """Tables A.1 and A.2: returns of the demonstrations by mode, and Cohen's d between modes."""
    returns = {mode: _returns(pools, mode) for mode in MODES}
    first: list[Row] = []
    for mode, of_mode in returns.items():
        for signal, values in of_mode.items():
            mean, sd = thesis_values.TABLE_A_1[mode][signal]
            ours = {"ours": float(values.mean()), "ours_sd": float(values.std(ddof=1))}
            thesis = {"thesis": mean, "thesis_sd": sd}
            first.append({"mode": mode, "signal": signal} | thesis | ours)
    second: list[Row] = []
    for (a, b), signals in thesis_values.TABLE_A_2.items():
        for signal in ("g_self", "g_global", "g_env", "g_social"):
            second.append(
                {"first": a, "second": b, "signal": signal}
                | {"thesis": signals.get(signal, ""), "thesis_from_a_1": _printed_d(a, b, signal)}
                | {"ours": cohens_d(returns[a][signal], returns[b][signal])}
            )
    return first, second


def _printed_d(first: str, second: str, signal: str) -> float:
    """Cohen's d that follows from the thesis' Table A.1, for groups of one size."""
    (mean, sd), (other, its_sd) = (thesis_values.TABLE_A_1[m][signal] for m in (first, second))
    return (mean - other) / float(np.hypot(sd, its_sd) / np.sqrt(2))


def distributions(pools: Path) -> list[Row]:
    """Fig A.1: how the rewards of a decision are distributed, by mode and signal.

    Shares of the decisions in 40 equal bins between the 0.5 and 99.5 percentiles of all modes;
    what lies beyond counts in the outermost bins.
    """
    values: dict[str, dict[str, np.ndarray]] = {}
    for mode in MODES:
        shown = files.load(pools / f"{mode}.safetensors")
        classical, _ = load_arrays(pools / f"{mode}_classical.safetensors", "classical", 1)
        values[mode] = {"r_self": classical["own"], "r_global": classical["others"]}
        values[mode] |= {"r_env": shown.rewards.env, "r_social": shown.rewards.social}
    found: list[Row] = []
    for signal in ("r_self", "r_global", "r_env", "r_social"):
        everything = np.concatenate([values[mode][signal] for mode in MODES])
        low, high = np.quantile(everything, [0.005, 0.995])
        edges = np.linspace(float(low), float(high), 41)
        for mode in MODES:
            clipped = np.clip(values[mode][signal], edges[0], edges[-1])
            counts, _ = np.histogram(clipped, edges)
            found += [
                {"mode": mode, "signal": signal, "from": low, "to": high, "share": share}
                for low, high, share in zip(
                    edges[:-1], edges[1:], counts / len(clipped), strict=True
                )
            ]
    return found


def _returns(pools: Path, mode: str) -> dict[str, np.ndarray]:
    """Undiscounted sums over each recorded episode."""
    shown = files.load(pools / f"{mode}.safetensors")
    classical, _ = load_arrays(pools / f"{mode}_classical.safetensors", "classical", 1)
    starts = shown.episode_starts
    return {
        "g_self": np.add.reduceat(classical["own"], starts),
        "g_global": np.add.reduceat(classical["others"], starts),
        "g_env": shown.totals().env,
        "g_social": shown.totals().social,
    }


def best_angles(rows: Sequence[Row]) -> list[Row]:
    """For each policy the angles at which it is the best of all given ones."""
    points = {f"{r['policy']} {r['readout']}": (r["r_env"], r["r_social"]) for r in rows}
    intervals = support_intervals(points)
    found = []
    for row in rows:
        interval = intervals[f"{row['policy']} {row['readout']}"]
        low, high = interval or ("", "")
        kept: dict[str, Any] = {name: row[name] for name in ("policy", "readout")}
        kept |= {name: row[name] for name in ("r_env", "r_social", "angle")}
        found.append(kept | {"best_from": low, "best_to": high})
    return found


def group_spread(episodes: Episodes, config: Config) -> dict[str, float]:
    """Standard deviation of each metric over groups of episodes, as over evaluation seeds."""
    size = config.group_episodes
    groups = [slice(i * size, (i + 1) * size) for i in range(config.evaluation_seeds)]
    rows = [outcome_row(part(episodes, group)) for group in groups]
    return {
        name: float(np.std([row[name] for row in rows], ddof=1))
        for name in ("collision", "arrival", "timeout", "speed_kmh", "stopped")
    }


def part(episodes: Episodes, which: slice) -> Episodes:
    """Some of the episodes."""
    kept: dict[str, Any] = {}
    for name, value in episodes._asdict().items():
        if name == "signal_names":
            kept[name] = value
        elif isinstance(value, tuple):
            kept[name] = type(value)(*(column[which] for column in value))
        else:
            kept[name] = value[which]
    return Episodes(**kept)
