"""A look at a network now and then while it trains: its greedy episodes, and the best one kept."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.evaluation.metrics import Metrics
from socialiq.evaluation.play import episodes_of
from socialiq.experiments.results import as_csv
from socialiq.learners.state import History
from socialiq.nn.q_network import QNetwork, network_of
from socialiq.nn.q_policy import QPolicy
from socialiq.storage import write_atomically
from socialiq.to_json import rounded
from socialiq.types import Row
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.options import Options

SEEN = ("total", "collision", "arrival", "timeout", "r_env", "r_social")
"""Measures of a check; `total` is J(α), the mean total scored at the run's own angle."""


@dataclass(frozen=True)
class Checks:
    """Interval of a run's checks, and their episodes.

    Attributes:
        times: Checks of a run, spread evenly; the last one at its end.
        episodes: Episodes of a check.
        first_seed: Of these episodes, the same ones at every check.
    """

    times: int = 20
    episodes: int = 300
    first_seed: int = 5_000_000

    def due(self, chunk: int, chunks: int) -> bool:
        """Whether a run of so many chunks is looked at after this one (from 1)."""
        return (chunk * self.times) // chunks > ((chunk - 1) * self.times) // chunks


@dataclass
class Monitor:
    """Callback after each chunk: the measured values where a check is due, else NaN.

    Attributes:
        checks: When, and on what.
        options: The scenario.
        angle: At which the value is scored, in degrees.
        chunk: Updates of a chunk.
        chunks: Chunks of the run.
        updates: Updates done, of a `TrainState`.
        as_policy: Makes a policy of the network.
        best: File of the best network so far, kept if given.
    """

    checks: Checks
    options: Options
    angle: float
    chunk: int
    chunks: int
    updates: Callable[[Any], int]
    as_policy: Callable[[QNetwork], QPolicy]
    best: Path | None = None

    def __call__(self, state: Any) -> dict[str, np.ndarray]:
        """Measured values of the one lane, each (1,)."""
        done = self.updates(state)
        if not self.checks.due(math.ceil(done / self.chunk), self.chunks):
            return {name: np.array([np.nan]) for name in SEEN}
        policy = self.as_policy(network_of(state.network, 0))
        metrics = self._measured(policy)
        found = {"total": metrics.value(self.angle)}
        found |= {name: getattr(metrics, name) for name in SEEN[1:]}
        if self.best:
            self._keep(policy, done, found["total"])
        return {name: np.array([value]) for name, value in found.items()}

    def _measured(self, policy: QPolicy) -> Metrics:
        first, count = self.checks.first_seed, self.checks.episodes
        batch = Batch(self.options, min(count, 256))
        return episodes_of(batch, policy, np.arange(first, first + count)).metrics()

    def _keep(self, policy: QPolicy, done: int, total: float) -> None:
        """Keep the network if none was better; of two equal ones the earlier stays."""
        assert self.best is not None  # the caller has looked
        if self.best.is_file() and QPolicy.load(self.best).provenance["check"]["total"] >= total:
            return
        check = {"updates": done, "total": total, "episodes": self.checks.episodes}
        provenance = {**policy.provenance, "check": check}
        dataclasses.replace(policy, provenance=provenance).save(self.best)


def write_curve(history: History, path: Path) -> None:
    """The checked points of a training run as CSV: updates, loss terms, measured values."""
    arrays = {name: history.array(name)[:, 0] for name in history.values}
    rows: list[Row] = [
        {"updates": updates} | {name: rounded(float(array[i])) for name, array in arrays.items()}
        for i, updates in enumerate(history.updates)
        if np.isfinite(arrays["total"][i])
    ]
    write_atomically(path, as_csv(rows))
