"""Training jobs of policy iteration in the intersection: networks of one angle, and dials."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.evaluation.road_training import Checks, dial_labeller, observes_time, sizes_of
from socialiq.learners.policy_iteration import dial
from socialiq.learners.policy_iteration import train as one_angle
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_network import network_of
from socialiq.worlds.intersection.options import Options
from socialiq_lab.intersection.episodes import DIAL
from socialiq_lab.intersection.fitting import fit
from socialiq_lab.jobs import ProgressCallback


@dataclass(frozen=True)
class DialIterationRun:
    """One run of direct policy iteration of a dial, which begins with the job's input."""

    structure: dial.DialIterationConfig
    numbers: one_angle.IterationHyperparameters
    environments: int = 256
    options: Options = field(default_factory=Options)
    checks: Checks = field(default_factory=lambda: Checks(times=8, episodes=200))
    check_angles: tuple[float, ...] = (0.0, 45.0, 90.0)
    """Angles of a check, in degrees."""


def train_dial_by_iteration(
    config: DialIterationRun,
    folder: Path,
    inputs: Mapping[str, Path],
    on_progress: ProgressCallback,
) -> None:
    """Improve the dial of the input; write it and its learning curve, which is of J(α)."""
    (begun,) = inputs.values()
    start = DialPolicy.load(begun / DIAL)
    clock = observes_time(start, config.options)
    structure, numbers = dial.with_network_of(config.structure, start), config.numbers

    def measure(state: Any, _done: int) -> dict[str, float]:
        network = network_of(state.target_network, 0)
        policy = DialPolicy.of(network, 1.0, structure.low, structure.high, {})
        values = [
            config.checks.measured(config.options, policy.at(angle), angle)["total"]
            for angle in config.check_angles
        ]
        return {"total": float(np.mean(values))}

    labeller = dial_labeller(structure, config.options, config.environments, clock)
    fitting = partial(
        dial.train,
        structure,
        [numbers],
        [labeller],
        sizes_of(config.options, clock),
        start=start,
    )
    monitor = config.checks.monitor(structure.updates, measure, "total")
    fit(fitting, folder, on_progress, [DIAL], monitor)
