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
    "two_way": ("socialiq/TwoWay-v1", {}),
    "intersection-crosswalk": ("socialiq/IntersectionCrosswalk-v1", {"cyclist_rate": 0.1}),
    "crossing7-with-clock": ("socialiq/Crossing7-v1", {"clock": True, "angle": 30.0}),
    "intersection-with-clock": ("socialiq/Intersection-v1", {"clock": True, "angle": 60.0}),
    "intersection-shifted": (
        "socialiq/Intersection-v1",
        {"shift": "late,noise=1", "front_end": "known"},
    ),
    "merge-with-clock": ("socialiq/Merge-v1", {"clock": True, "angle": 45.0}),
    "road": ("socialiq/Road-v1", {"seed": 1}),
    "road-left-hand": ("socialiq/Road-v1", {"seed": 2, "left_hand": True}),
}
"""Gymnasium id and options by name."""

SUMO: dict[str, tuple[str, dict[str, Any]]] = {
    "sumo": ("socialiq/Sumo-v1", {}),
    "sumo-with-clock": ("socialiq/Sumo-v1", {"clock": True, "following": "IDM", "angle": 45.0}),
    "sumo-weighted": (
        "socialiq/Sumo-v1",
        {"pedestrian_weight": 2.0, "bicycle_rate": 0.3, "after_timeout": "removed"},
    ),
    "sumo-row": ("socialiq/SumoRow-v1", {}),
}
"""Worlds in SUMO by name."""

DECISIONS_IN_SUMO = 45

DEMAND = """<routes>
  <vType id="courier" vClass="bicycle" sigma="0.7"/>
  <flow id="a" begin="0" end="600" vehsPerHour="360" from="WC" to="CE"/>
  <flow id="b" type="courier" begin="10" end="500" number="40" from="NC" to="CS"/>
  <trip id="c" depart="12.5" from="EC" to="CN"/>
  <personFlow id="p" begin="0" end="600" period="20"><walk from="WC" to="CE"/></personFlow>
</routes>"""
"""Traffic of a user, in SUMO's XML."""

VECTORS: dict[str, tuple[str, dict[str, Any]]] = {
    "intersection": ("socialiq/Intersection-v1", {}),
    "intersection-same-step": ("socialiq/Intersection-v1", {"mode": "SameStep", "clock": True}),
    "intersection-continuous": ("socialiq/IntersectionContinuousSteering-v1", {}),
    "roundabout": ("socialiq/Roundabout-v1", {"mode": "SameStep"}),
}
"""Gymnasium id and options of vector environments."""


def trace(identity: str, options: dict[str, Any], _folder: Path) -> Hashes:
    """Trace an environment."""
    return traced(identity, options, DECISIONS)


def traced(identity: str, options: dict[str, Any], decisions: int) -> Hashes:
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
    for _ in range(decisions):
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


def trace_in_sumo(identity: str, options: dict[str, Any], _folder: Path) -> Hashes:
    """Trace a world in SUMO, whose decisions take longer."""
    return traced(identity, options, DECISIONS_IN_SUMO)


def trace_demand(folder: Path) -> Hashes:
    """Trace a world in SUMO with the traffic of a user's file, and a state that is played again."""
    from socialiq.worlds.environment import make_environment

    path = folder / "mine.rou.xml"
    path.write_text(DEMAND)
    hashes = traced("socialiq/Sumo-v1", {"demand": str(path)}, DECISIONS_IN_SUMO)
    env: Any = make_environment("sumo", {"demand": str(path)}).unwrapped
    env.reset(seed=5)
    for action in (2, 1, 0):
        env.step(action)
    state = env.save()
    following = env.step(2)
    restored = env.restore(state)
    assert np.array_equal(env.step(2)[0], following[0])
    pair = following[4]["reward_pair"]
    return hashes | {"restored": of_array(np.append(restored, pair), exact=True)}


def trace_vector(identity: str, options: dict[str, Any], _folder: Path) -> Hashes:
    """Drive episodes side by side by random actions, with resets by the mode."""
    import gymnasium
    from gymnasium.vector import AutoresetMode

    import socialiq

    assert socialiq.__all__
    further = {name: value for name, value in options.items() if name != "mode"}
    mode = AutoresetMode(options.get("mode", "NextStep"))
    env = gymnasium.make_vec(identity, num_envs=3, autoreset_mode=mode, **further)
    env.action_space.seed(0)
    columns: dict[str, list[Any]] = {"observations": [env.reset(seed=4)[0]], "results": []}
    final = []
    for _ in range(DECISIONS // 4):
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
        columns["observations"].append(observation)
        ended = np.stack([terminated, truncated, info["_ending"], info["off_road"]])
        numbers = [reward, *info["reward_pair"].T, info["ending"], info["contact"], info["speed"]]
        columns["results"].append(np.array([*numbers, *ended], np.float64))
        final += [one.tolist() for one in info.get("final_obs", ()) if one is not None]
    env.close()
    hashes = {name: of_array(np.array(rows), exact=True) for name, rows in columns.items()}
    return hashes | {"final_observations": of_plain(final)}


def trace_at_junction(folder: Path) -> Hashes:
    """Trace a recorded junction."""
    return trace("socialiq/RecordedJunction-v0", {"file": str(junction_file(folder))}, folder)


ITEMS = [
    *(
        Item(f"trace/{name}", functools.partial(trace, *environment), quick=True)
        for name, environment in ENVIRONMENTS.items()
    ),
    *(
        Item(f"trace/{name}", functools.partial(trace_in_sumo, *environment), ("libsumo",))
        for name, environment in SUMO.items()
    ),
    Item("trace/sumo-demand", trace_demand, ("libsumo",)),
    *(
        Item(f"vector/{name}", functools.partial(trace_vector, *environment), quick=True)
        for name, environment in VECTORS.items()
    ),
    Item("trace/recorded-junction", trace_at_junction, ("shapely",)),
]
