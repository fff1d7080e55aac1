"""Configuration of the study of the dial, and rows of a trained dial: regrets and mixtures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from socialiq.errors import UserError
from socialiq.evaluation.dial import Sweep, sweep
from socialiq.evaluation.exact import READOUTS, Ground, action_table
from socialiq.evaluation.rollout import rollout_totals
from socialiq.learners.dial.config import RUNS
from socialiq.mdp.front import AttainableSet
from socialiq.nn.dial_policy import DialPolicy
from socialiq.social.angle import angle_difference, angle_of
from socialiq.social.dial import Setting, mixed_angle, mixture, setting
from socialiq.types import Row

KEY_ANGLES = tuple(np.arange(0.0, 91.0, 15.0).tolist())
"""Angles in degrees whose mean regret is the key regret of a dial."""


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    seeds: tuple[int, ...] = (30, 31, 32, 33, 34, 35, 36, 37, 38, 39)
    """Training seeds, each with its own data set. 0 to 9 were used in development."""
    episodes_each: int = 60
    """Demonstrated episodes of each expert."""
    runs: tuple[str, ...] = tuple(RUNS)
    """Names of `learners.dial.config.PRESETS`."""
    updates: int | None = None
    """Gradient steps instead of each run's own number, to try the study."""
    wanted: tuple[float, ...] = tuple(np.arange(0.0, 91.0, 5.0).tolist())
    """Behavioural angles of the mixtures."""
    rollouts: int = 1000
    """Episodes of each requested angle, from which mixtures are estimated."""
    budgets: tuple[float, ...] = (0.05, 0.2, 0.5, 1.0, 2.0)
    """ε of the agents whose strength follows from a budget of regret, beside the run `offline`."""
    budget_angle: float = 45.0
    """Angle of these agents in degrees."""
    budget_seeds: tuple[int, ...] = (30, 31, 32)
    """Training seeds, among `seeds`."""


class TrainedDial(NamedTuple):
    """A trained dial of a run and a seed, with its ground."""

    name: str
    seed: int
    dial: DialPolicy
    ground: Ground

    def rows(self, config: Config, limit: AttainableSet) -> Iterator[tuple[str, list[Row]]]:
        """Yield rows by table; `limit` has the best values within the run's support."""
        best = self.ground.optimum.attainable
        for readout in READOUTS:
            swept = sweep(self.dial, self.ground.part, readout)
            label = {"run": self.name, "seed": self.seed, "readout": readout}
            yield "angles", _angle_rows(label, swept, best)
            if readout == "greedy":
                settings = self._settings(label, config, swept, limit)
                yield "settings", settings
                yield "dials", [_dial_row(label, swept, best, limit, settings)]
            else:
                yield "dials", [_dial_row(label, swept, best, limit, [])]

    def _settings(
        self, label: Row, config: Config, swept: Sweep, limit: AttainableSet
    ) -> list[Row]:
        """Return the mixture for each wanted angle, exact and estimated from rollouts."""
        best, points = self.ground.optimum.attainable, swept.points
        totals = self._rollouts(config, swept)
        estimated = np.array([episodes.mean(axis=0) for episodes in totals])
        rows = []
        for wanted in config.wanted:
            row = label | {"wanted": wanted} | dict.fromkeys(_SETTING, "")
            row |= {"share_of_radius": 0.0, "share_of_support": 0.0}
            if exact := _reached(points, wanted):
                row |= {
                    "first": swept.angles[exact.first],
                    "second": swept.angles[exact.second],
                    "share": exact.share,
                    "radius": exact.radius,
                    "share_of_radius": exact.radius / best.radius(wanted),
                    "share_of_support": exact.radius / limit.radius(wanted),
                }
            if guess := _reached(estimated, wanted):
                achieved = mixture(points, guess)
                error = angle_difference(angle_of(*achieved), wanted)
                interval = mixed_angle(
                    totals[guess.first], totals[guess.second], guess.share, self.seed
                )
                row |= {
                    "estimated_share": guess.share,
                    "estimated_angle_error": error,
                    "estimated_low": interval.low,
                    "estimated_high": interval.high,
                    "estimated_covers": int(interval.low <= wanted + error <= interval.high),
                    "estimated_share_of_radius": float(np.hypot(*achieved)) / best.radius(wanted),
                }
            rows.append(row)
        return rows

    def _rollouts(self, config: Config, swept: Sweep) -> list[np.ndarray]:
        """Return the totals of the episodes of each requested angle."""
        return [
            rollout_totals(
                self.ground.part,
                action_table(self.dial.at(angle), self.ground.part, "greedy"),
                config.rollouts,
                seed=1000 * self.seed + number,
            )
            for number, angle in enumerate(swept.angles)
        ]


_SETTING = (
    "first",
    "second",
    "share",
    "radius",
    "share_of_radius",
    "share_of_support",
    "estimated_share",
    "estimated_angle_error",
    "estimated_low",
    "estimated_high",
    "estimated_covers",
    "estimated_share_of_radius",
)


def _reached(points: np.ndarray, angle: float) -> Setting | None:
    """Return the mixture of these policies at an angle, or None without one."""
    try:
        return setting(points, angle)
    except UserError:
        return None


def _angle_rows(label: Row, swept: Sweep, best: AttainableSet) -> list[Row]:
    """Return the metrics and the regret at every fifth degree."""
    regrets = swept.regrets(best)
    return [
        label
        | {"angle": angle}
        | metrics._asdict()
        | {"behavioural_angle": metrics.angle, "angle": angle, "regret": float(regret)}
        for angle, metrics, regret in zip(swept.angles, swept.metrics, regrets, strict=True)
        if angle % 5 == 0
    ]


def _dial_row(
    label: Row, swept: Sweep, best: AttainableSet, limit: AttainableSet, settings: list[Row]
) -> Row:
    """Return the numbers of one dial."""
    regrets = dict(zip(swept.angles, swept.regrets(best), strict=True))
    back = swept.backward_steps()
    shares = [row["share_of_radius"] for row in settings]
    supported = [row["share_of_support"] for row in settings]
    errors = [abs(error) for row in settings if (error := row["estimated_angle_error"]) != ""]
    ceiling = np.mean(
        [best.optimum(angle).value - limit.optimum(angle).value for angle in KEY_ANGLES]
    )
    key = float(np.mean([regrets[angle] for angle in KEY_ANGLES]))
    return label | {
        "key_regret": key,
        "ceiling": float(ceiling),
        "above_ceiling": key - float(ceiling),
        "mean_regret": float(np.mean(list(regrets.values()))),
        "worst_regret": float(max(regrets.values())),
        "rise_r_env": back.env,
        "drop_r_social": back.social,
        "least_share_of_radius": min(shares) if shares else "",
        "least_share_of_support": min(supported) if supported else "",
        "mean_estimated_error": float(np.mean(errors)) if errors else "",
        "worst_estimated_error": max(errors) if errors else "",
    }
