"""Update rates of soft actor-critic beside Stable-Baselines3's, on one thread each.

Both take a step of Pendulum-v1 for each update. Ours acts in rounds of many steps and learns in one
compiled program; the peer steps and updates in turn. Compilation is not counted.
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


def run(repeats: int) -> dict[str, Any]:
    """Measure each side in turn, `repeats` times.

    Returns:
        By size medians of updates per second, and the median of the ratios.

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
        pairs = [
            (ours(width, batch), peer(stable_baselines3.SAC, width, batch)) for _ in range(repeats)
        ]
        found[f"{name}_ours_updates_per_second"] = statistics.median(a for a, _ in pairs)
        found[f"{name}_sb3_updates_per_second"] = statistics.median(b for _, b in pairs)
        found[f"{name}_ratio"] = statistics.median(a / b for a, b in pairs)
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
