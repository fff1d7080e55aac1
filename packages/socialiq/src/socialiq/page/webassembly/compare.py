"""Equality of two replays of the same episodes, counted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from socialiq.page.webassembly.replay import Replay
from socialiq.worlds.highway.state import EPISODE
from socialiq.worlds.intersection.state import VEHICLE

CLOSE = 1e-9
"""Largest difference of a state that counts as close: m, rad, m/s, m/s²."""


@dataclass(frozen=True)
class Equality:
    """Counts of a comparison; a pair of equal things is counted, and all pairs.

    Attributes:
        episodes: Number of episodes.
        same_endings: Episodes with the same ending after the same number of decisions.
        decisions: Number of decisions.
        same_decisions: Decisions that the driver takes too from what it sees in the other replay.
        observations: Number of observations, those of the resets included.
        equal_observations: Those equal to the last bit (float32).
        equal_rewards: Reward pairs equal to the last bit.
        close_rewards: Reward pairs that differ by at most `CLOSE`.
        equal_states: States, the random stream's included, equal to the last bit.
        close_states: States whose numbers differ by at most `CLOSE` and that are equal otherwise.
        largest: Largest difference of any number of a state.
    """

    episodes: int
    same_endings: int
    decisions: int
    same_decisions: int
    observations: int
    equal_observations: int
    equal_rewards: int
    close_rewards: int
    equal_states: int
    close_states: int
    largest: float


def compared(native: Replay, compiled: Replay, policy: Any = None) -> Equality:
    """Count what is equal in two replays with the same decisions.

    Args:
        native: First replay.
        compiled: Second replay.
        policy: Driver that is asked again on what it sees in the second replay; None if it
            doesn't look, so that every decision is the same.
    """
    decided = native.actions >= 0
    there = np.vstack([np.ones_like(decided[:1]), decided])  # states that an episode reached
    ours, arrays = native.arrays, compiled.arrays
    equal_inputs = (ours["observation"] == arrays["observation"]).all(axis=(2, 3))
    apart = np.abs(ours["rewards"] - arrays["rewards"]).max(axis=2)[1:]
    ended = ours["ending"] == arrays["ending"]
    equal, gap = _states(ours, arrays)
    return Equality(
        episodes=decided.shape[1],
        same_endings=int((ended | ~there).all(axis=0).sum()),
        decisions=int(decided.sum()),
        same_decisions=int((_again(compiled, policy) == native.actions)[decided].sum()),
        observations=int(there.sum()),
        equal_observations=int(equal_inputs[there].sum()),
        equal_rewards=int((apart == 0)[decided].sum()),
        close_rewards=int((apart <= CLOSE)[decided].sum()),
        equal_states=int((equal & (gap == 0))[there].sum()),
        close_states=int((equal & (gap <= CLOSE))[there].sum()),
        largest=float(gap[there].max()),
    )


def _again(replay: Replay, policy: Any) -> np.ndarray:
    """Return the decisions that a driver takes on the observations of a replay."""
    if policy is None:
        return replay.actions
    observations = replay.arrays["observation"][:-1]
    inputs = observations.reshape(-1, observations.shape[2] * observations.shape[3])
    return np.asarray(policy.predict(inputs, deterministic=True)[0]).reshape(replay.actions.shape)


def _states(
    ours: dict[str, np.ndarray], arrays: dict[str, np.ndarray]
) -> tuple[Bool[np.ndarray, "step episode"], Float[np.ndarray, "step episode"]]:
    """Return whether all but floats is equal, and the largest difference of floats."""
    count = ours["episodes"]["vehicles"]
    absent = np.arange(ours["vehicles"].shape[2]) >= count[..., None]
    equal, gap = np.ones(count.shape, bool), np.zeros(count.shape)
    for name in EPISODE.names or ():
        _note(ours["episodes"][name], arrays["episodes"][name], None, equal, gap)
    for name in VEHICLE.names or ():
        _note(ours["vehicles"][name], arrays["vehicles"][name], absent, equal, gap)
    return equal, gap


def _note(left: Any, right: Any, absent: Any, equal: np.ndarray, gap: np.ndarray) -> None:
    if left.dtype.kind != "f":
        same = left == right
        equal &= same if absent is None else (same | absent).all(axis=2)
        return
    with np.errstate(invalid="ignore"):  # infinity less infinity: a speed without a limit
        apart = np.where(left == right, 0.0, np.abs(left - right))
    np.maximum(gap, apart if absent is None else np.where(absent, 0.0, apart).max(axis=2), out=gap)
