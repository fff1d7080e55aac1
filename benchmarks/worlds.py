"""Policy steps per second of the compiled roads: the core beside the real highway-env, in one run.

Both drive the same episodes, random actions, resets included. Measured in turn, so that a busy
machine slows both; medians are given. Compilation is measured apart, in processes of their own.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from socialiq.nn.dial_policy import DialPolicy
from socialiq.policies.front_end import FrontEndPolicy
from socialiq.worlds.highway.effects import CAUSED
from socialiq.worlds.highway.perception import FrontEnd
from socialiq.worlds.highway.scene_batch import Batch
from socialiq.worlds.highway.scenes import SCENES
from socialiq.worlds.highway.world import world_of
from socialiq.worlds.intersection.options import MULTI_AGENT, ContinuousOptions, Options
from socialiq.worlds.intersection.world import Intersection
from socialiq.worlds.registry import make_fleet, open_world

HIGHWAY_STEPS = 150
SINGLE_STEPS = 5_000
CORE_STEPS = 30_000
EFFECTS_STEPS = 10_000
FLEETS = (2, 4)  # agents
DIAL = Path("results/intersection-dial-clock/iterated.safetensors")
BATCH = 64  # for one thread
WIDE_BATCH = 1024  # for two: below that they wait for one another
DENSITIES = (0.0, 0.3, 0.6, 1.0)  # spawn probabilities

_START = """
import time
import numba
from socialiq.worlds.intersection.world import Intersection
from socialiq.worlds.intersection.options import Options
begin = time.perf_counter()
Intersection(Options()).batch(1).reset(0)
print(time.perf_counter() - begin)
"""


def run(repeats: int) -> dict[str, Any]:
    """Measure each side in turn, `repeats` times.

    Returns:
        Medians by name: steps per second, ratios, seconds.

    Raises:
        UserError: If highway-env is not installed.
    """
    options = Options()
    real = real_environment(options)
    core = Intersection(options).batch(BATCH)
    single = gymnasium.make("socialiq/Intersection-v1")
    vector = gymnasium.make_vec("socialiq/Intersection-v1", num_envs=BATCH)
    steered = ContinuousOptions(actions="continuous_steering")
    real_steered, core_steered = real_environment(steered), Intersection(steered).batch(BATCH)
    wide = {threads: Intersection(options).batch(WIDE_BATCH, threads) for threads in (1, 2)}
    rates: dict[str, list[float]] = {}
    for _ in range(repeats):
        _note(rates, "highway_env_steps_per_s", lambda: real_steps_per_second(real))
        _note(rates, "steps_per_s_1_thread", lambda: steps_per_second(core, CORE_STEPS))
        _note(rates, "make_steps_per_s", lambda: real_steps_per_second(single, SINGLE_STEPS))
        _note(rates, "make_vec_steps_per_s", lambda: vector_steps_per_second(vector))
        _note(rates, "highway_env_steered_per_s", lambda: real_steps_per_second(real_steered))
        _note(rates, "steered_per_s_1_thread", lambda: steps_per_second(core_steered, CORE_STEPS))
        for threads, batch in wide.items():
            name = f"steps_per_s_{threads}_threads" if threads > 1 else "steps_per_s_wide_1_thread"
            _note(rates, name, lambda batch=batch: steps_per_second(batch, 2 * CORE_STEPS))
    found = {name: statistics.median(values) for name, values in rates.items()}
    ratios = np.divide(rates["steps_per_s_1_thread"], rates["highway_env_steps_per_s"])
    registered = {
        name: np.divide(rates[f"{name}_steps_per_s"], rates["highway_env_steps_per_s"])
        for name in ("make", "make_vec")
    }
    steering = np.divide(rates["steered_per_s_1_thread"], rates["highway_env_steered_per_s"])
    scaling = np.divide(rates["steps_per_s_2_threads"], rates["steps_per_s_wide_1_thread"])
    return {
        **found,
        "ratio": float(np.median(ratios)),
        **{f"{name}_ratio": float(np.median(pairs)) for name, pairs in registered.items()},
        "steered_ratio": float(np.median(steering)),
        "two_thread_scaling": float(np.median(scaling)),
        **other_roads(repeats),
        **fleets(repeats),
        **effects_costs(repeats),
        **by_density(repeats),
        **start_up(repeats),
        **decisions(repeats),
    }


def other_roads(repeats: int) -> dict[str, float]:
    """Steps per second of the other roads on both sides, and the median ratio."""
    from socialiq.worlds.highway.reference import RealScene

    found = {}
    for name in SCENES:
        core = world_of(name).batch(BATCH)
        real = RealScene(core.scene, core.options).environment
        pairs = [
            (scene_steps_per_second(core), scene_real_steps_per_second(real, core.options.duration))
            for _ in range(repeats)
        ]
        found[f"{name}_steps_per_s"], found[f"highway_env_{name}_per_s"] = np.median(pairs, axis=0)
        found[f"{name}_ratio"] = float(np.median([ours / theirs for ours, theirs in pairs]))
    return {name: float(value) for name, value in found.items()}


def fleets(repeats: int) -> dict[str, float]:
    """Return decisions of agents per second with several, as in intersection-multi-agent-v0."""
    found = {}
    for agents in FLEETS:
        batch = make_fleet(agents=agents, **MULTI_AGENT).batch(WIDE_BATCH)
        real = real_environment(batch.options)
        pairs = []
        for _ in range(repeats):
            ours = agents * scene_steps_per_second(batch, 2 * CORE_STEPS)
            pairs.append((ours, agents * real_steps_per_second(real)))
        name, (ours, theirs) = f"{agents}_agents", np.median(pairs, axis=0)
        found |= {f"{name}_per_s": ours, f"highway_env_{name}_per_s": theirs}
        found[f"{name}_ratio"] = np.median([ours / theirs for ours, theirs in pairs])
    return {name: float(value) for name, value in found.items()}


def effects_costs(repeats: int) -> dict[str, float]:
    """Return how many times as long a decision takes with the measure of effects, by road."""
    costs = {}
    for name in ("intersection", *SCENES):
        plain, measured = (open_world(f"{name}{end}").batch(BATCH) for end in ("", CAUSED))
        pairs = [
            (
                scene_steps_per_second(plain, EFFECTS_STEPS),
                scene_steps_per_second(measured, EFFECTS_STEPS),
            )
            for _ in range(repeats)
        ]
        costs[f"{name}_effects_cost"] = float(np.median([rate / slower for rate, slower in pairs]))
    return costs


def scene_steps_per_second(batch: Any, steps: int = CORE_STEPS) -> float:
    """Policy steps per second of a road under random actions, resets included."""
    rounds = steps // batch.size
    actions = np.random.default_rng(0).integers(batch.n_actions, size=(rounds, *batch.shape))
    batch.reset(0)
    begin = time.perf_counter()
    for row in actions:
        batch.step(row)
    return rounds * batch.size / (time.perf_counter() - begin)


def scene_real_steps_per_second(environment: Any, duration: float) -> float:
    """The same of highway-env's own class, with the same end of an episode."""
    actions = drawn(environment.action_space, HIGHWAY_STEPS)
    environment.reset(seed=0)
    begin = time.perf_counter()
    for action in actions:
        _, _, terminated, _, _ = environment.step(action)
        if terminated or environment.time >= duration:
            environment.reset()
    return HIGHWAY_STEPS / (time.perf_counter() - begin)


def _note(rates: dict[str, list[float]], name: str, measure: Callable[[], float]) -> None:
    rates.setdefault(name, []).append(measure())


def real_environment(options: Options) -> Any:
    """highway-env's own class with our configuration and nothing around it."""
    from socialiq.worlds.intersection.reference import IntersectionEnv, environment_config

    return IntersectionEnv(config=environment_config(options))


def real_steps_per_second(environment: Any, steps: int = HIGHWAY_STEPS) -> float:
    """Policy steps per second of a Gymnasium environment, random actions, resets included."""
    actions = drawn(environment.action_space, steps)
    environment.reset(seed=0)
    begin = time.perf_counter()
    for action in actions:
        _, _, terminated, truncated, _ = environment.step(action)
        if terminated or truncated:
            environment.reset()
    return steps / (time.perf_counter() - begin)


def decisions(repeats: int) -> dict[str, float]:
    """Microseconds of the shipped dial at 45 degrees for one observation, and of a front end."""
    policy = DialPolicy.load(DIAL).at(45.0)
    behind = FrontEndPolicy(policy, FrontEnd(latency=1, track=3), policy.n_features)
    environment = gymnasium.make("socialiq/Intersection-v1", clock=True)
    observation, _ = environment.reset(seed=0)

    def microseconds(chooser: Any) -> float:
        memory, begin = None, time.perf_counter()
        for _ in range(SINGLE_STEPS):
            _, memory = chooser.predict(observation, memory)
        return 1e6 * (time.perf_counter() - begin) / SINGLE_STEPS

    choosers = {"predict_us": policy, "front_end_predict_us": behind}
    return {
        name: statistics.median(microseconds(chooser) for _ in range(repeats))
        for name, chooser in choosers.items()
    }


def vector_steps_per_second(environments: Any) -> float:
    """Policy steps per second of vectorised environments, which begin ended episodes again."""
    rounds = CORE_STEPS // environments.num_envs
    actions = drawn(environments.single_action_space, rounds, environments.num_envs)
    environments.reset(seed=0)
    begin = time.perf_counter()
    for row in actions:
        environments.step(row)
    return rounds * environments.num_envs / (time.perf_counter() - begin)


def steps_per_second(batch: Batch, steps: int) -> float:
    """Policy steps per second of a batch under random actions, resets included."""
    rounds = -(-steps // batch.size)
    actions = drawn(Intersection(batch.options).action_space, rounds, batch.size)
    batch.reset(0)
    begin = time.perf_counter()
    for row in actions:
        batch.step(row)
    return rounds * batch.size / (time.perf_counter() - begin)


def drawn(space: Any, *shape: int) -> Any:
    """Uniform actions of a space, of this shape."""
    rng = np.random.default_rng(0)
    if isinstance(space, spaces.Tuple):  # of several agents
        agents = rng.integers(space[0].n, size=(*shape, len(space)))
        return [tuple(row) for row in agents]
    if isinstance(space, spaces.Discrete):
        return rng.integers(space.n, size=shape)
    return rng.uniform(space.low, space.high, (*shape, *space.shape)).astype(np.float32)


def by_density(repeats: int) -> dict[str, float]:
    """Microseconds of a step, and vehicles present, by spawn probability."""
    found = {}
    for probability in DENSITIES:
        batch = Intersection(Options(spawn_probability=probability)).batch(BATCH)
        rates = [steps_per_second(batch, CORE_STEPS) for _ in range(repeats)]
        name = f"spawn_{probability:g}"
        found[f"{name}_us_per_step"] = 1e6 / statistics.median(rates)
        found[f"{name}_vehicles"] = float(np.mean(batch.buffers.present[:, 0]))
    return found


def start_up(repeats: int) -> dict[str, float]:
    """Seconds until the first episode has begun: compiled first, and from the cache on disk."""
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {"NUMBA_CACHE_DIR": folder}

        def seconds() -> float:
            done = subprocess.run(
                [sys.executable, "-c", _START], env=environment, capture_output=True, check=True
            )
            return float(done.stdout)

        return {"compile_s": seconds(), "cached_start_s": min(seconds() for _ in range(repeats))}
