"""Traces of each core of simulation: 200 decisions by fixed seeds, hashed to the last bit."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import numpy as np
from tests.digest.commands import junction_file
from tests.digest.digest import Hashes, Item, of_array, of_plain

DECISIONS = 200

ENVIRONMENTS: dict[str, tuple[str, dict[str, Any]]] = {
    "crossing5": ("socialiq/Crossing5-v1", {}),
    "crossing7": ("socialiq/Crossing7-v1", {}),
    "crosswalk7": ("socialiq/Crosswalk7-v1", {}),
    "intersection": ("socialiq/Intersection-v1", {}),
    "intersection-left": ("socialiq/Intersection-v1", {"destination": "left"}),
    "intersection-straight": ("socialiq/Intersection-v1", {"destination": "straight"}),
    "intersection-right": ("socialiq/Intersection-v1", {"destination": "right"}),
    "intersection-continuous": ("socialiq/IntersectionContinuous-v1", {}),
    "intersection-steering": ("socialiq/IntersectionContinuousSteering-v1", {}),
    "intersection-steering-offroad": ("socialiq/IntersectionContinuousSteeringOffroad-v1", {}),
    "merge": ("socialiq/Merge-v1", {}),
    "roundabout": ("socialiq/Roundabout-v1", {}),
}
"""Gymnasium id and options by name."""


def trace(identity: str, options: dict[str, Any], _folder: Path) -> Hashes:
    """Drive by random actions; hash observations, rewards, reward pairs, signals and endings."""
    import gymnasium

    import socialiq

    assert socialiq.__all__  # importing it registers the environments
    env = gymnasium.make(identity, disable_env_checker=True, **options)
    env.action_space.seed(0)
    episode = 0
    observation, _ = env.reset(seed=episode)
    observed, pairs, rewards = [observation], [], []
    endings: list[Any] = []
    signals: list[Any] = []
    for _ in range(DECISIONS):
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
        observed.append(observation)
        pairs.append(info["reward_pair"])
        rewards.append(reward)
        endings.append([bool(terminated), bool(truncated), str(info.get("ending"))])
        signals.append(info.get("signals", {}))
        if terminated or truncated:
            episode += 1
            observation, _ = env.reset(seed=episode)
            observed.append(observation)
    env.close()
    names = sorted(signals[0])
    return {
        "observations": of_array(np.array(observed), exact=True),
        "reward_pairs": of_array(np.array(pairs), exact=True),
        "rewards": of_array(np.array(rewards, np.float64), exact=True),
        "endings": of_plain(endings),
        "signals": of_plain(
            {
                name: of_array(np.array([one[name] for one in signals], np.float64), exact=True)
                for name in names
            }
        ),
    }


def trace_at_junction(folder: Path) -> Hashes:
    """Trace a recorded junction."""
    return trace("socialiq/RecordedJunction-v0", {"file": str(junction_file(folder))}, folder)


ITEMS = [
    Item(f"trace/{name}", functools.partial(trace, *environment), quick=True)
    for name, environment in ENVIRONMENTS.items()
] + [Item("trace/recorded-junction", trace_at_junction, ("shapely",))]
