"""Update rates of soft actor-critic beside Stable-Baselines3's, on one core each by `taskset`.

Both take a step of Pendulum-v1 for each update. Ours acts in rounds of many steps and learns in one
compiled program; the peer steps and updates in turn. Compilation is not counted. The products of
matrices of an update, alone in one compiled program, bound the rate that either side can reach.
"""

from __future__ import annotations

import statistics
import time
from typing import Any

from socialiq.errors import UserError
from socialiq.learners.acting import acting_in
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.continuous.config import SACConfig, SACHyperparameters
from socialiq.learners.continuous.train import train
from socialiq.worlds.environment import make_environment

SIZES = {"small": (64, 64), "standard": (256, 256)}
"""By name: width of both hidden layers, and rows of an update."""
ROUND = 400  # updates of ours that are timed, after as many that compile
PEER_UPDATES = 300
WARM_UP = 100  # first steps, with uniform actions
PRODUCTS = 16
"""Products of (rows, width) and (width, width) in an update with two hidden layers.

The actor at the next observations 1, target critics 2, critics 2 forward and 4 back, the actor 1
forward and 2 back, critics under its loss 2 forward and 2 back.
"""


def run(repeats: int) -> dict[str, Any]:
    """Measure each side in turn, `repeats` times.

    Returns:
        By size medians of updates per second, the median of the ratios, and that of the bare
        products over ours: the factor that is left.

    Raises:
        UserError: If Stable-Baselines3 is not installed.
    """
    try:
        import stable_baselines3
        import torch
    except ImportError as error:
        raise UserError(
            "this benchmark needs Stable-Baselines3: pip install 'socialiq-lab[sb3]'"
        ) from error
    torch.set_num_threads(1)
    found: dict[str, Any] = {}
    for name, (width, batch) in SIZES.items():
        rows = [
            (
                ours(width, batch),
                peer(stable_baselines3.SAC, width, batch),
                products_alone(width, batch),
            )
            for _ in range(repeats)
        ]
        sides = ("ours", "sb3", "products")
        for side, rates in zip(sides, zip(*rows, strict=True), strict=True):
            found[f"{name}_{side}_updates_per_second"] = statistics.median(rates)
        found[f"{name}_ratio"] = statistics.median(a / b for a, b, _ in rows)
        found[f"{name}_factor_left"] = statistics.median(c / a for a, _, c in rows)
    return found | {"repeats": repeats}


def ours(width: int, batch: int) -> float:
    """Updates per second of one run, a step in the environment for each."""
    static = SACConfig(
        hidden=(width, width),
        batch_size=batch,
        updates=2 * ROUND,
        updates_per_round=ROUND,
        random_steps=WARM_UP,
    )
    runs, stamps = [SACHyperparameters()], []
    acting = acting_in(
        lambda: make_environment("Pendulum-v1", continuous=True), static, runs, ROUND
    )
    callbacks = Callbacks(on_report=lambda _: stamps.append(time.perf_counter()))
    train(
        static,
        runs,
        sizes=(3, 1),
        callbacks=callbacks,
        chunk=ROUND,
        before_chunk=acting,
    )
    return ROUND / (stamps[-1] - stamps[-2])


def peer(kind: Any, width: int, batch: int) -> float:
    """Updates per second of Stable-Baselines3's soft actor-critic."""
    model = kind(
        "MlpPolicy",
        "Pendulum-v1",
        batch_size=batch,
        learning_starts=WARM_UP,
        ent_coef=0.2,
        policy_kwargs={"net_arch": [width, width]},
        seed=0,
        device="cpu",
    )
    model.learn(WARM_UP + 10)
    began = time.perf_counter()
    model.learn(PEER_UPDATES, reset_num_timesteps=False)
    return PEER_UPDATES / (time.perf_counter() - began)


def products_alone(width: int, batch: int) -> float:
    """Updates per second if an update were its products of matrices and nothing else."""
    import jax
    import jax.numpy as jnp

    keys = jax.random.split(jax.random.key(0), PRODUCTS)
    weights = [jax.random.normal(key, (width, width)) / width**0.5 for key in keys]

    @jax.jit
    def updates(rows: Any) -> Any:
        def update(rows: Any, _: None) -> tuple[Any, None]:
            for weight in weights:
                rows = rows @ weight
            return rows, None

        return jax.lax.scan(update, rows, None, length=ROUND)[0]

    rows = jnp.ones((batch, width))
    jax.block_until_ready(updates(rows))
    began = time.perf_counter()
    jax.block_until_ready(updates(rows))
    return ROUND / (time.perf_counter() - began)
