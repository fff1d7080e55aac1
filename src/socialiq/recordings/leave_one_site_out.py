"""Agreement of learned policies with recorded drivers, by leave-one-site-out.

Every site is held out once, and policies learned from the others predict its drivers' actions.
Agreement does not measure an angle: the policy of 90 degrees is not meant to drive as people do.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float64, Int64

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.learners import behaviour_cloning
from socialiq.learners.iq_learn.config import Endings, StaticConfig
from socialiq.learners.iq_learn.presets import (
    INTERSECTION_CALIBRATED,
    INTERSECTION_CALIBRATED_NUMBERS,
    offline,
)
from socialiq.learners.iq_learn.train import train
from socialiq.recordings.splits import recordings_of, site_of, split
from socialiq.types import Row


@dataclass(frozen=True)
class Config:
    """Settings of the training.

    Attributes:
        angles: Target angles of IQ-Learn, degrees.
        updates: Gradient steps of each learner.
        batch_size: Transitions of a batch.
        hidden: Widths of the hidden layers.
        seed: Seed of both learners.
    """

    angles: tuple[float, ...] = (0.0, 45.0, 90.0)
    updates: int = 2000
    batch_size: int = 64
    hidden: tuple[int, ...] = (64, 64)
    seed: int = 0

    def static(self) -> StaticConfig:
        """Return IQ-Learn's offline configuration; leaving the view is a truncation."""
        return dataclasses.replace(
            offline(INTERSECTION_CALIBRATED),
            endings=Endings(timeout="bootstrap"),
            updates=self.updates,
            batch_size=self.batch_size,
            hidden=self.hidden,
        )


@dataclass(frozen=True)
class HeldOut:
    """Agreement on held-out sites.

    Attributes:
        rows: A row for each site and method: decisions, share predicted, mean negative
            log-likelihood in nats.
        finite: Whether every loss was finite.
        failures: A line for each run that stopped.
    """

    rows: list[Row]
    finite: bool
    failures: tuple[str, ...]

    def by_method(self) -> list[Row]:
        """Return the results over all held-out decisions, by method."""
        found = []
        for method in dict.fromkeys(row["method"] for row in self.rows):
            own = [row for row in self.rows if row["method"] == method]
            size = np.array([row["decisions"] for row in own], np.float64)
            shares = np.array([row["agreement"] for row in own])
            surprise = np.array([row["surprise"] for row in own])
            found.append(
                {
                    "method": method,
                    "sites": len(own),
                    "decisions": int(size.sum()),
                    "agreement": float((shares * size).sum() / size.sum()),
                    "surprise": float((surprise * size).sum() / size.sum()),
                }
            )
        return found


def held_out(table: Demonstrations, config: Config) -> HeldOut:
    """Hold out each site that has an episode once, with all its recordings.

    Args:
        table: Demonstrations of an ego swap.
        config: Settings of the training.

    Raises:
        UserError: If fewer than two sites have episodes.
    """
    names, place = recordings_of(table)
    used = [name for number, name in enumerate(names) if (place == number).any()]
    sites = sorted({site_of(name) for name in used})
    if len(sites) < 2:
        raise UserError("agreement on held-out sites needs at least two with an episode")
    splits = [split(table, [name for name in used if site_of(name) == site]) for site in sites]
    seen = [train_on for train_on, _ in splits]
    hyperparameters = [
        dataclasses.replace(
            INTERSECTION_CALIBRATED_NUMBERS, angle=angle, dataset=place, seed=config.seed
        )
        for place in range(len(sites))
        for angle in config.angles
    ]
    trained = train(config.static(), hyperparameters, seen)
    shape = behaviour_cloning.StaticConfig(
        hidden=config.hidden, batch_size=config.batch_size, updates=config.updates
    )
    clones = [
        behaviour_cloning.Hyperparameters(dataset=place, seed=config.seed)
        for place in range(len(sites))
    ]
    cloned = behaviour_cloning.clone(shape, clones, seen)
    rows: list[Row] = []
    for number, (train_on, test) in enumerate(splits):
        shares = np.bincount(train_on.action, minlength=table.n_actions) + 1.0
        chances = {"majority": np.tile(shares / shares.sum(), (test.n_transitions, 1))}
        policy = cloned.policy(number)
        chances["behaviour cloning"] = policy.probabilities(test.observation)
        for run, one in enumerate(hyperparameters):
            if one.dataset == number:
                policy = trained.policy(run)
                chances[f"IQ-Learn, {one.angle:g}°"] = policy.probabilities(test.observation)
        rows += [
            {"site": sites[number], "method": method} | _score(found, test.action)
            for method, found in chances.items()
        ]
    losses = np.concatenate(
        [trained.history.array("loss").ravel(), cloned.history.array("loss").ravel()]
    )
    return HeldOut(rows, bool(np.isfinite(losses).all()), trained.failures)


def _score(
    chances: Float64[np.ndarray, "decision action"], action: Int64[np.ndarray, " decision"] | Any
) -> Row:
    hit = chances.argmax(axis=1) == action
    chosen = chances[np.arange(len(action)), action]
    return {
        "decisions": len(action),
        "agreement": float(hit.mean()),
        "surprise": float(-np.log(np.maximum(chosen, 1e-300)).mean()),
    }
