"""Parts of the thesis' Tables 6.2, A.1 and A.2 and its comparisons that studies share."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from socialiq.demonstrations import files
from socialiq.evaluation.episodes import outcome_row
from socialiq.evaluation.measures import Episodes
from socialiq.evaluation.rollout import MODES
from socialiq.statistics.comparisons import cohens_d
from socialiq.storage import load_arrays
from socialiq.types import Row
from socialiq_lab.intersection import thesis_values
from socialiq_lab.registry import declaration
from socialiq_lab.tables import paired_row, with_holm

PERCENT = ("collision", "arrival", "timeout", "stopped")
"""Metrics of Table 6.2 that are printed in percent."""


def group_spread(episodes: Episodes, config: Any, metric: str) -> float:
    """Return the standard deviation of a metric over groups of evaluation episodes.

    Args:
        episodes: Evaluation episodes of one policy.
        config: Configuration of the study; `group_episodes` and `evaluation_seeds` are read.
        metric: Name of a column of `outcome_row`.
    """
    size = config.group_episodes
    rows = [
        outcome_row(episodes.rows(slice(n * size, (n + 1) * size)))
        for n in range(config.evaluation_seeds)
    ]
    return float(np.std([row[metric] for row in rows], ddof=1))


def separability(recordings: Path) -> tuple[list[Row], list[Row]]:
    """Return Tables A.1 and A.2: returns of demonstrations by mode, Cohen's d between modes.

    Args:
        recordings: Folder of the recordings of a trio of experts.
    """
    returns: dict[str, dict[str, np.ndarray]] = {}
    for mode in MODES:  # undiscounted sums over each recorded episode
        recorded = files.load(recordings / f"{mode}.safetensors")
        signals = signals_of(recordings, mode)
        starts = recorded.episode_starts
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


def signals_of(recordings: Path, mode: str) -> dict[str, np.ndarray]:
    """Return both kinds of rewards of each recorded decision of a mode, by name.

    Args:
        recordings: Folder of the recordings of a trio of experts.
        mode: Mode of the expert.
    """
    recorded = files.load(recordings / f"{mode}.safetensors")
    classical, _ = load_arrays(recordings / f"{mode}_classical.safetensors", "classical", 1)
    signals = {"r_self": classical["own"], "r_global": classical["others"]}
    return signals | {"r_env": recorded.rewards.env, "r_social": recorded.rewards.social}


class Comparison(NamedTuple):
    """Two policies and a metric that the thesis compares."""

    place: str  # section of the thesis
    first: str  # A learner's target
    second: str  # another learner's target, or "expert MODE"
    metric: str  # column of the policies' table


COMPARISONS = tuple(
    Comparison(entry["place"], entry["first"], entry["second"], metric)
    for entry in declaration("intersection")["comparison"]
    for metric in entry["metrics"]
)


def compared(label: Row, by_policy: Mapping[str, Sequence[Row]]) -> list[Row]:
    """Test every difference that the thesis claims, over paired replicates.

    Args:
        label: First columns of each row.
        by_policy: Metrics of each target and expert, a row for each replicate, in one order.

    Returns:
        A row for each comparison, with p adjusted by Holm over them.
    """
    family: list[Row] = []
    for comparison in COMPARISONS:
        first, second = (
            [row.get(comparison.metric, "") for row in by_policy[policy]]
            for policy in (comparison.first, comparison.second)
        )
        if "" not in (*first, *second) and len(first) > 1:
            family.append(paired_row(label | comparison._asdict(), first, second))
    return with_holm(family)
