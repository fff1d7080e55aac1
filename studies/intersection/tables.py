"""The thesis' tables with our numbers beside its own: 6.1, 6.2, A.1, A.2, Fig A.1."""

import itertools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax
import numpy as np

from socialiq.demonstrations import files
from socialiq.evaluation.episodes import Episodes, outcome_row
from socialiq.evaluation.rollout import MODES
from socialiq.statistics.comparisons import cohens_d
from socialiq.storage import load_arrays
from socialiq.types import Row
from socialiq_lab.intersection import thesis_values
from socialiq_lab.intersection.rows import PolicyEpisodes
from studies.intersection.plan import columns

PERCENT = ("collision", "arrival", "timeout", "stopped")
READOUTS = ("greedy", "soft")


def table_6_2(
    rows: Mapping[tuple[str, str], Row], episodes: PolicyEpisodes, config: Any
) -> list[Row]:
    """Return Tables 6.1 and 6.2: each metric of experts and learners beside the thesis' value.

    `over_training` is the standard deviation over training seeds, empty for a single expert;
    `over_evaluation` that over groups of evaluation episodes, averaged over training seeds.
    """
    table: list[Row] = []
    for (group, policies), metric in itertools.product(
        columns(config).items(), thesis_values.METRICS
    ):
        for readout, (policy, names) in itertools.product(READOUTS, policies.items()):
            if any((name, readout) not in rows for name in names):
                continue  # experts are evaluated greedily only
            factor = 100 if metric in PERCENT else 1
            values = [factor * rows[name, readout][metric] for name in names]
            spreads = [factor * group_spread(episodes[n, readout], config, metric) for n in names]
            mean, spread = thesis_values.TABLE_6_2[metric][policy]
            table.append(
                dict(zip(("preset", "setting"), group, strict=True))
                | {"readout": readout, "policy": policy, "metric": metric}
                | {"thesis": mean, "thesis_spread": spread, "ours": float(np.mean(values))}
                | {"over_training": float(np.std(values, ddof=1)) if len(values) > 1 else ""}
                | {"over_evaluation": float(np.mean(spreads))}
                | {"low": min(values), "high": max(values), "seeds": len(values)}
            )
    return table


def group_spread(episodes: Episodes, config: Any, metric: str) -> float:
    """Return the standard deviation of a metric over groups of evaluation episodes."""
    size, columns_of = config.group_episodes, episodes._replace(signal_names=())
    rows = [
        outcome_row(jax.tree.map(lambda values, n=n: values[n * size : (n + 1) * size], columns_of))
        for n in range(config.evaluation_seeds)
    ]
    return float(np.std([row[metric] for row in rows], ddof=1))


def separability(recordings: Path) -> tuple[list[Row], list[Row]]:
    """Return Tables A.1 and A.2: returns of demonstrations by mode, Cohen's d between modes."""
    returns: dict[str, dict[str, np.ndarray]] = {}
    for mode in MODES:  # undiscounted sums over each recorded episode
        recorded = files.load(recordings / f"{mode}.safetensors")
        signals, starts = _signals(recordings, mode), recorded.episode_starts
        returns[mode] = {
            "g_self": np.add.reduceat(signals["r_self"], starts),
            "g_global": np.add.reduceat(signals["r_global"], starts),
            "g_env": recorded.totals().env,
            "g_social": recorded.totals().social,
        }
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
            (mean_a, sd_a), (mean_b, sd_b) = (thesis_values.TABLE_A_1[m][signal] for m in (a, b))
            from_a_1 = (mean_a - mean_b) / float(np.hypot(sd_a, sd_b) / np.sqrt(2))
            second.append(
                {"first": a, "second": b, "signal": signal}
                | {"thesis": signals.get(signal, ""), "thesis_from_a_1": from_a_1}
                | {"ours": cohens_d(returns[a][signal], returns[b][signal])}
            )
    return first, second


def distributions(recordings: Path) -> list[Row]:
    """Return the distribution of the rewards of a decision, by mode and signal (Fig A.1).

    40 equal bins between the 0.5 and 99.5 percentiles; values beyond count in the outermost.
    """
    values = {mode: _signals(recordings, mode) for mode in MODES}
    table: list[Row] = []
    for signal in ("r_self", "r_global", "r_env", "r_social"):
        everything = np.concatenate([values[mode][signal] for mode in MODES])
        low, high = np.quantile(everything, [0.005, 0.995])
        edges = np.linspace(float(low), float(high), 41)
        for mode in MODES:
            clipped = np.clip(values[mode][signal], edges[0], edges[-1])
            shares = np.histogram(clipped, edges)[0] / len(clipped)
            table += [
                {"mode": mode, "signal": signal, "from": low, "to": high, "share": share}
                for low, high, share in zip(edges[:-1], edges[1:], shares, strict=True)
            ]
    return table


def _signals(recordings: Path, mode: str) -> dict[str, np.ndarray]:
    """Return both kinds of rewards of each recorded decision of a mode."""
    recorded = files.load(recordings / f"{mode}.safetensors")
    classical, _ = load_arrays(recordings / f"{mode}_classical.safetensors", "classical", 1)
    signals = {"r_self": classical["own"], "r_global": classical["others"]}
    return signals | {"r_env": recorded.rewards.env, "r_social": recorded.rewards.social}
