"""Deep Q-learning at the intersection: ours beside Stable-Baselines3 on highway-env, in one run.

Both train the thesis' network on the same reward with 12 environments and one update of 256 for 48
environment steps. Stable-Baselines3 uses 12 processes on all cores; ours is one process that is
kept to one core, since independent runs are fastest that way. Compilation is counted on neither
side. The last lines compare the updates' arithmetic with a plain matrix product on the same core.
"""

from __future__ import annotations

import itertools
import json
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from socialiq.errors import UserError

ENVIRONMENTS = 12
HIDDEN = (256, 256)
BATCH = 256
PEER_STEPS = 1_200
OUR_STEPS = 96_000
UPDATES = 400
PRODUCT = 1024  # rows and columns

_OURS = "import json; from experts import ours; print(json.dumps(ours({steps})))"


def run(repeats: int) -> dict[str, Any]:
    """Measure each side in turn, `repeats` times.

    Returns:
        Medians by name: steps and updates per second, ratio, share of the matrix throughput.

    Raises:
        UserError: If Stable-Baselines3 or highway-env is not installed.
    """
    try:
        import stable_baselines3  # noqa: F401
    except ImportError as error:
        raise UserError(
            "this benchmark needs the extra sb3: pip install 'socialiq-lab[sb3]'"
        ) from error
    rows = [{"peer_steps_per_s": peer_steps_per_second()} | _pinned() for _ in range(repeats)]
    found = {name: statistics.median(row[name] for row in rows) for name in rows[0]}
    ratios = [row["steps_per_s"] / row["peer_steps_per_s"] for row in rows]
    return found | {"ratio": statistics.median(ratios)}


def peer_steps_per_second() -> float:
    """Stable-Baselines3's DQN with 12 subprocesses of the real highway-env."""
    import gymnasium
    import torch
    from stable_baselines3 import DQN
    from stable_baselines3.common.vec_env import SubprocVecEnv

    def make() -> Any:
        import socialiq  # noqa: F401  registers the worlds, in a process that starts from nothing

        return gymnasium.make("socialiq/Intersection-v1", back_end="highway_env")

    torch.set_num_threads(1)
    environments = SubprocVecEnv([make] * ENVIRONMENTS)
    learner = DQN(
        "MlpPolicy",
        environments,
        learning_rate=3e-4,
        batch_size=BATCH,
        learning_starts=ENVIRONMENTS,
        train_freq=4,
        gradient_steps=1,
        policy_kwargs={"net_arch": list(HIDDEN)},
        seed=0,
    )
    learner.learn(5 * ENVIRONMENTS)  # processes started, buffers made
    begin = time.perf_counter()
    learner.learn(PEER_STEPS, reset_num_timesteps=False)
    seconds = time.perf_counter() - begin
    environments.close()
    return PEER_STEPS / seconds


def _pinned() -> dict[str, float]:
    """Our side in a process that never sees more than one core."""
    core = min(os.sched_getaffinity(0))
    done = subprocess.run(
        ["taskset", "-c", str(core), sys.executable, "-c", _OURS.format(steps=OUR_STEPS)],
        cwd=Path(__file__).parent,
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout)


def ours(steps: int) -> dict[str, float]:
    """Steps per second with learning, updates per second, and their share of the throughput."""
    marks: list[tuple[int, float]] = []
    train_(steps, marks)
    (first, began), (last, ended) = marks[0], marks[-1]
    updates = updates_per_second()
    product = product_flops_per_second()
    return {
        "steps_per_s": 48 * (last - first) / (ended - began),
        "updates_per_s": updates,
        "matrix_gflops": product / 1e9,
        "share_of_matrix_throughput": updates * update_flops() / product,
    }


def train_(steps: int, marks: list[tuple[int, float]]) -> None:
    """A short run; notes (updates done, time) after each chunk."""
    from gymnasium.vector import AutoresetMode

    from socialiq.learners.callbacks import Callbacks
    from socialiq.learners.collect import from_vector_env
    from socialiq.learners.dqn import DQNConfig, DQNHyperparameters, train
    from socialiq.worlds.gym import RoadVectorEnv

    static = DQNConfig(hidden=HIDDEN, steps=steps, steps_per_update=48, batch_size=BATCH)
    env = RoadVectorEnv(num_envs=ENVIRONMENTS, autoreset_mode=AutoresetMode.SAME_STEP)
    callbacks = Callbacks(lambda report: marks.append((report.done, time.perf_counter())))
    source = from_vector_env(env, 200 * static.steps_per_update)
    train(static, [DQNHyperparameters()], [source], (70, 3), callbacks, 200)


def updates_per_second() -> float:
    """Updates alone, from a full replay."""
    import jax
    import jax.numpy as jnp

    from socialiq.learners.dqn import DQN, DQNConfig, DQNHyperparameters
    from socialiq.learners.expert_table import Replay
    from socialiq.learners.state import stack

    static = DQNConfig(hidden=HIDDEN, batch_size=BATCH, replay_capacity=20_000)
    hyperparameters, learner = stack([DQNHyperparameters()])[0], DQN(static, (70, 3))
    state, carry = learner.initialise(hyperparameters)
    full = Replay(carry.replay.columns, jnp.asarray(static.replay_capacity))
    carry = carry._replace(replay=full)

    @jax.jit
    def advance(state: Any, carry: Any) -> Any:
        def body(run: Any, _: None) -> Any:
            return learner.update(hyperparameters, *run)[:2], None

        return jax.lax.scan(body, (state, carry), None, length=UPDATES)[0]

    jax.block_until_ready(advance(state, carry))
    begin = time.perf_counter()
    jax.block_until_ready(advance(state, carry))
    return UPDATES / (time.perf_counter() - begin)


def update_flops() -> float:
    """Multiplications and additions of one double-Q update.

    Three forward passes and a backward one, which takes two.
    """
    sizes = (70, *HIDDEN, 3)
    forward = sum(2 * BATCH * a * b for a, b in itertools.pairwise(sizes))
    return 5.0 * forward


def product_flops_per_second() -> float:
    """Of a plain float32 matrix product in the same library."""
    import jax
    import jax.numpy as jnp

    square = jnp.ones((PRODUCT, PRODUCT))
    product = jax.jit(lambda a: a @ a)
    jax.block_until_ready(product(square))
    rates = []
    for _ in range(10):
        begin = time.perf_counter()
        jax.block_until_ready(product(square))
        rates.append(2.0 * PRODUCT**3 / (time.perf_counter() - begin))
    return statistics.median(rates)
