"""Splits by site or chain, and agreement of learned policies with the drivers of held-out sites.

Demonstrations are split by whole recordings: two episodes of one recording hold the same moments
from two vehicles, so a split inside a recording would test on training data. Recordings that share
a vehicle or a site (`recordings.identity`) stay on one side. For the agreement every site is held
out once, and policies learned from the others predict its drivers' actions.
Agreement does not measure an angle: the policy of 90 degrees is not meant to drive as people do.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Float64, Int64

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError, one_of
from socialiq.learners import behaviour_cloning
from socialiq.learners.iq_learn.config import Endings, StaticConfig
from socialiq.learners.iq_learn.presets import (
    INTERSECTION_CALIBRATED,
    INTERSECTION_CALIBRATED_NUMBERS,
    offline,
)
from socialiq.learners.iq_learn.train import train
from socialiq.types import Row
from socialiq_recordings.identity.identify import site_of as site_of

By = Literal["site", "chain"]


def recordings_of(table: Demonstrations) -> tuple[tuple[str, ...], Int64[np.ndarray, " episode"]]:
    """Return the names of a table's recordings, and the index of each episode's recording.

    Raises:
        UserError: If the table wasn't made by an ego swap, or its episodes were selected since.
    """
    listed, place = table.source.get("recordings"), table.source.get("episode_recording")
    if not isinstance(listed, list) or not isinstance(place, list):
        raise UserError(
            "these demonstrations lack the recording of each episode: make them with "
            "`socialiq data demonstrations`"
        )
    if len(place) != table.n_episodes:
        raise UserError("episodes were picked or repeated since the ego swap: split before that")
    return tuple(str(one["name"]) for one in listed), np.array(place, np.int64)


def groups_of(table: Demonstrations, by: By) -> tuple[str, ...]:
    """Return the site or the chain of each recording of a table.

    Raises:
        UserError: If its recordings were not identified.
    """
    recordings_of(table)
    found = tuple(str(one.get(by) or "") for one in table.source["recordings"])
    if not all(found):
        raise UserError(
            "these demonstrations lack the sites and chains of their recordings, so a split could "
            "leak: make them again with `socialiq data demonstrations`"
        )
    return found


def split(
    table: Demonstrations, held_out: Sequence[str], by: By = "site"
) -> tuple[Demonstrations, Demonstrations]:
    """Split a table by recording, so that no vehicle, no moment and no site is on both sides.

    Args:
        table: Demonstrations of an ego swap.
        held_out: Names of the recordings to keep for testing.
        by: "site" keeps sites apart; "chain" allows other vehicles and moments of one site.

    Returns:
        Training and held-out demonstrations, each with its own recordings only.

    Raises:
        UserError: If a name is unknown, one side would be empty (one recording can't be split), or
            both would hold a vehicle, a moment or a site.
    """
    one_of("by", by, get_args(By))
    names, place = recordings_of(table)
    unknown = [name for name in held_out if name not in names]
    if unknown:
        raise UserError(f"no recording '{unknown[0]}': choose from {', '.join(names)}")
    if len(names) < 2:
        raise UserError(
            f"there is one recording, {', '.join(names)}, and one can't be split: its vehicles "
            "see each other, so both sides would hold the same moments; add a recording"
        )
    held = np.isin(place, [names.index(name) for name in held_out])
    if held.all() or not held.any():
        raise UserError("both sides of a split need an episode: hold out some recordings, not all")
    for kept_apart in dict.fromkeys((by, "chain")):
        _check_apart(names, groups_of(table, kept_apart), held_out, kept_apart)
    return _side(table, ~held), _side(table, held)


def _check_apart(
    names: Sequence[str], groups: Sequence[str], held_out: Sequence[str], by: str
) -> None:
    """Raise an error if a recording that is not held out is of a held-out one's group."""
    held = {group: name for name, group in zip(names, groups, strict=True) if name in held_out}
    leaks = [(n, g) for n, g in zip(names, groups, strict=True) if n not in held_out and g in held]
    if leaks:
        name, group = leaks[0]
        more = f" (and {len(leaks) - 1} more)" if len(leaks) > 1 else ""
        what = "show one site" if by == "site" else "have vehicles in common"
        also = "; or split by chain, for other drivers of one site" if by == "site" else ""
        raise UserError(
            f"{held[group]} is held out and {name} is not{more}, but they {what}: hold out both"
            f"{also}"
        )


def _side(table: Demonstrations, chosen: np.ndarray) -> Demonstrations:
    episodes = np.flatnonzero(chosen)
    old = [table.source["episode_recording"][one] for one in episodes]
    kept = sorted(set(old))
    source = table.source | {
        "recordings": [table.source["recordings"][one] for one in kept],
        "episode_recording": [kept.index(one) for one in old],
        "episode_identity": [table.source["episode_identity"][one] for one in episodes],
    }
    arrays = table.select(episodes).arrays()
    return Demonstrations.of_arrays(arrays, table.mode_names, table.n_actions, source)


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


def agreement(table: Demonstrations, config: Config) -> HeldOut:
    """Hold out each site that has an episode once, with all its recordings.

    Args:
        table: Demonstrations of an ego swap.
        config: Settings of the training.

    Raises:
        UserError: If fewer than two sites have episodes.
    """
    names, place = recordings_of(table)
    site = dict(zip(names, groups_of(table, "site"), strict=True))
    used = [name for number, name in enumerate(names) if (place == number).any()]
    sites = sorted({site[name] for name in used})
    if len(sites) < 2:
        raise UserError(
            f"agreement on held-out sites needs at least two with an episode; all {len(used)} "
            f"recordings with one show {sites[0] if sites else 'none'}: add another place"
        )
    splits = [split(table, [name for name in names if site[name] == one]) for one in sites]
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
    cloned = behaviour_cloning.BehaviourCloning.train_on(shape, clones, seen)
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
