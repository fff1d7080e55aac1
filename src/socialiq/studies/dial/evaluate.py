"""One trained dial, and the rows that tell what it does."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from socialiq.errors import UserError
from socialiq.evaluation.dial import Sweep, sweep
from socialiq.evaluation.exact import READOUTS, action_table
from socialiq.evaluation.rollout import rollout_totals
from socialiq.experiments.gridworld_runs import Ground
from socialiq.mdp.front import AttainableSet
from socialiq.nn.dial_policy import DialPolicy
from socialiq.social.angle import angle_difference, angle_of
from socialiq.social.dial import Setting, mixed_angle, mixture, setting
from socialiq.studies.dial.config import KEY_ANGLES, Config
from socialiq.types import Row


class TrainedDial(NamedTuple):
    """One trained dial, and the rows that tell what it does."""

    name: str
    seed: int
    dial: DialPolicy
    ground: Ground

    def rows(self, config: Config, limit: AttainableSet) -> Iterator[tuple[str, list[Row]]]:
        """Rows by table. `limit` is what the run's support allows; everything online."""
        best = self.ground.optimum.attainable
        for readout in READOUTS:
            found = sweep(self.dial, self.ground.part, readout)
            label = {"run": self.name, "seed": self.seed, "readout": readout}
            yield "angles", _angle_rows(label, found, best)
            if readout == "greedy":
                settings = self._settings(label, config, found, limit)
                yield "settings", settings
                yield "dials", [_dial_row(label, found, best, limit, settings)]
            else:
                yield "dials", [_dial_row(label, found, best, limit, [])]

    def _settings(
        self, label: Row, config: Config, found: Sweep, limit: AttainableSet
    ) -> list[Row]:
        """The mixture for each wanted angle, exact and as rollouts have it."""
        best, points = self.ground.optimum.attainable, found.points
        totals = self._rollouts(config, found)
        estimated = np.array([one.mean(axis=0) for one in totals])
        rows = []
        for wanted in config.wanted:
            row = label | {"wanted": wanted} | dict.fromkeys(_SETTING, "")
            row |= {"share_of_radius": 0.0, "share_of_support": 0.0}
            if exact := _reached(points, wanted):
                row |= {
                    "first": found.angles[exact.first],
                    "second": found.angles[exact.second],
                    "share": exact.share,
                    "radius": exact.radius,
                    "share_of_radius": exact.radius / best.radius(wanted),
                    "share_of_support": exact.radius / limit.radius(wanted),
                }
            if guess := _reached(estimated, wanted):
                truly = mixture(points, guess)
                error = angle_difference(angle_of(*truly), wanted)
                interval = mixed_angle(
                    totals[guess.first], totals[guess.second], guess.share, self.seed
                )
                row |= {
                    "estimated_share": guess.share,
                    "estimated_angle_error": error,
                    "estimated_low": interval.low,
                    "estimated_high": interval.high,
                    "estimated_covers": int(interval.low <= wanted + error <= interval.high),
                    "estimated_share_of_radius": float(np.hypot(*truly)) / best.radius(wanted),
                }
            rows.append(row)
        return rows

    def _rollouts(self, config: Config, found: Sweep) -> list[np.ndarray]:
        """Totals of the episodes of each queried angle."""
        return [
            rollout_totals(
                self.ground.part,
                action_table(self.dial.at(angle), self.ground.part, "greedy"),
                config.rollouts,
                seed=1000 * self.seed + number,
            )
            for number, angle in enumerate(found.angles)
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
    """The mixture of these policies at an angle, if there is one."""
    try:
        return setting(points, angle)
    except UserError:
        return None


def _angle_rows(label: Row, found: Sweep, best: AttainableSet) -> list[Row]:
    """Every fifth degree: where the dial leads and what it costs."""
    regrets = found.regrets(best)
    return [
        label
        | {"angle": angle}
        | one._asdict()
        | {"behavioural_angle": one.angle, "angle": angle, "regret": float(regret)}
        for angle, one, regret in zip(found.angles, found.metrics, regrets, strict=True)
        if angle % 5 == 0
    ]


def _dial_row(
    label: Row, found: Sweep, best: AttainableSet, limit: AttainableSet, settings: list[Row]
) -> Row:
    """One dial in numbers."""
    regrets = dict(zip(found.angles, found.regrets(best), strict=True))
    back = found.backward_steps()
    shares = [row["share_of_radius"] for row in settings]
    supported = [row["share_of_support"] for row in settings]
    errors = [abs(one) for row in settings if (one := row["estimated_angle_error"]) != ""]
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
