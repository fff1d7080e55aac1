"""GPI-LS of `morl-baselines`, tabular, as it is, on a gridworld of `compare methods`.

Called in the environment of `morl.txt` with a folder: it reads world.npz and requests.json there,
and writes policies.npz, a table of action probabilities for each request and weight.
"""

# The library is in the environment of morl.txt alone.
# pyright: reportMissingImports=false

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from morl_baselines.multi_policy.multi_policy_moqlearning.mp_mo_q_learning import MPMOQLearning
from tabular_env import TabularEnv

ITERATIONS, EVALUATED = 7, 5
"""Weights that are learned one after the other, and episodes in which each is then evaluated; these
come on top of the environment steps."""


def train(world: Any, request: dict[str, Any]) -> MPMOQLearning:
    """Train tables for the weights that GPI-LS selects; an update for each environment step."""
    env = TabularEnv(world, vector=True)
    env.reset(seed=request["seed"])
    steps = request["updates"] // ITERATIONS
    agent = MPMOQLearning(
        env,
        weight_selection_algo="gpi-ls",
        learning_rate=request["learning_rate"],
        gamma=request["discount"],
        initial_epsilon=1.0,
        final_epsilon=0.05,
        epsilon_decay_steps=steps // 2,
        use_gpi_policy=True,
        transfer_q_table=bool(request["transfer"]),
        log=False,
        seed=request["seed"],
    )
    agent.train(
        total_timesteps=steps * ITERATIONS,
        eval_env=TabularEnv(world, vector=True),
        ref_point=np.full(2, -100.0),
        timesteps_per_iteration=steps,
        num_eval_episodes_for_front=EVALUATED,
    )
    return agent


def greedy(agent: MPMOQLearning, world: Any, pair: list[float]) -> np.ndarray:
    """Return the greedy policy at a pair of weights, which the library wants to sum to 1."""
    weight = np.array(pair) / np.sum(pair)
    rows = [agent.eval(observation, weight) for observation in world["observation"]]
    return np.eye(world["successor"].shape[1])[rows]


def main(folder: Path) -> None:
    """Train every request, and write its tables."""
    world = dict(np.load(folder / "world.npz"))
    made, seconds, updates = {}, 0.0, 0
    for number, request in enumerate(json.loads((folder / "requests.json").read_text())):
        np.random.seed(request["seed"])  # noqa: NPY002 - the library draws from it
        began = time.perf_counter()
        agent = train(world, request)
        seconds += time.perf_counter() - began
        updates += request["updates"]
        for place, pair in enumerate(request["weights"]):
            made[f"policy_{number}_{place}"] = greedy(agent, world, pair)
    np.savez(folder / "policies.npz", updates_per_second=updates / seconds, **made)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
