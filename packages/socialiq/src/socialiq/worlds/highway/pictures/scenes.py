"""Scenes for pictures and films, from the arrays of a batch."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from socialiq.types import Ending, Policy, RewardPair
from socialiq.worlds.highway.episodes import RoadBatch
from socialiq.worlds.highway.options import RoadOptions
from socialiq.worlds.highway.pictures.render import Scene
from socialiq.worlds.highway.settings import SIGNALS


def present_scene(batch: RoadBatch, row: int = 0) -> Scene:
    """Return the current scene of one episode, with the rewards of its last decision.

    Args:
        batch: The episodes.
        row: Index of the episode.
    """
    buffers = batch.buffers
    count, ego = int(buffers.episodes[row]["vehicles"]), int(buffers.episodes[row]["ego"])
    vehicles = buffers.vehicles[row, :count].copy()
    charged = buffers.after["identity"][row][buffers.braking[row]]
    time = float(buffers.episodes[row]["time"])
    braking = np.isin(vehicles["identity"], charged) & (time > 0)
    return Scene(vehicles, ego, braking, *_rewards(batch, row, time > 0), time, "")


def decision_scenes(batch: RoadBatch, row: int = 0) -> Iterator[Scene]:
    """Return the sub-steps of an episode's last decision; the batch must be `traced`.

    Args:
        batch: The episodes.
        row: Index of the episode.
    """
    buffers = batch.buffers
    count, ego = int(buffers.present[row, 0]), int(buffers.present[row, 1])
    rewards = _rewards(batch, row, True)
    end = float(buffers.episodes[row]["time"])
    for frame, vehicles in enumerate(buffers.trace[row]):
        time = end - (len(buffers.trace[row]) - 1 - frame) / batch.options.simulation_frequency
        braking = buffers.braking[row, :count].copy()
        yield Scene(vehicles[:count].copy(), ego, braking, *rewards, time, "")


def episode_scenes(batch: RoadBatch, policy: Policy, seed: int) -> list[Scene]:
    """Run one episode and return its first state and every sub-step.

    Args:
        batch: Batch of one episode, which is `traced`.
        policy: Policy of the ego.
        seed: Seed of the episode.
    """
    batch.reset([seed])
    scenes, ending = [present_scene(batch)], Ending.NONE
    while ending == Ending.NONE:
        action, _ = policy.predict(batch.seen_by(policy))
        ending = Ending(int(batch.step(action, auto_reset=False).ending[0]))
        scenes += decision_scenes(batch)
    return [*scenes[:-1], scenes[-1]._replace(caption=ending.name.lower())]


def _rewards(batch: RoadBatch, row: int, begun: bool) -> tuple[dict[str, float], RewardPair]:
    buffers = batch.buffers
    signals = {
        name: float(weight_of(batch.options, name) * value) if begun else 0.0
        for name, value in zip(SIGNALS, buffers.signals[row], strict=True)
    }
    return signals, RewardPair(*(buffers.rewards[row] * begun).tolist())


def weight_of(options: RoadOptions, signal: str) -> float:
    """Return a signal's weight in its reward."""
    return float(getattr(options, f"{signal}_weight"))
