"""GAIL, AIRL and SQIL of `imitation`, as they are, on a gridworld of `compare methods`.

Called in the environment of `imitation.txt` with a folder: it reads world.npz and requests.json
there, and writes policies.npz, a table of action probabilities for each request.
"""

# The library is in the environment of imitation.txt alone.
# pyright: reportMissingImports=false

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from imitation.algorithms.adversarial.airl import AIRL
from imitation.algorithms.adversarial.gail import GAIL
from imitation.algorithms.sqil import SQIL
from imitation.data.types import Transitions
from imitation.rewards.reward_nets import BasicRewardNet, BasicShapedRewardNet
from imitation.util.networks import RunningNorm
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv
from tabular_env import NONE, TabularEnv

ENVIRONMENTS, ROLLOUT = 8, 32
"""Environments side by side of PPO, and steps of each in a round."""

torch.set_num_threads(1)


def train_adversarial(world: Any, request: dict[str, Any]) -> Any:
    """Train GAIL or AIRL; the number of environment steps is that of the request's updates."""
    venv = DummyVecEnv([lambda: TabularEnv(world)] * ENVIRONMENTS)
    venv.seed(request["seed"])
    generator = PPO(
        "MlpPolicy",
        venv,
        learning_rate=request["learning_rate"],
        n_steps=ROLLOUT,
        batch_size=request["batch_size"],
        gamma=request["discount"],
        ent_coef=0.01,
        policy_kwargs={"net_arch": request["hidden"]},
        seed=request["seed"],
        device="cpu",
    )
    net, trainer = {"gail": (BasicRewardNet, GAIL), "airl": (BasicShapedRewardNet, AIRL)}[
        request["learner"]
    ]
    reward_net = net(venv.observation_space, venv.action_space, normalize_input_layer=RunningNorm)
    trained = trainer(
        demonstrations=demonstrations(world, request["dataset"], request["batch_size"]),
        demo_batch_size=request["batch_size"],
        n_disc_updates_per_round=int(request["discriminator_updates"]),
        venv=venv,
        gen_algo=generator,
        reward_net=reward_net,
        allow_variable_horizon=True,
    )
    trained.train(max(request["updates"], ROLLOUT * ENVIRONMENTS))

    def probabilities(observation: torch.Tensor) -> torch.Tensor:
        return trained.policy.get_distribution(observation).distribution.probs

    return probabilities


def train_sqil(world: Any, request: dict[str, Any]) -> Any:
    """Train SQIL: deep Q-learning with reward 1 for demonstrations and 0 for own steps."""
    venv = DummyVecEnv([lambda: TabularEnv(world)])
    venv.seed(request["seed"])
    trained = SQIL(
        venv=venv,
        demonstrations=demonstrations(world, request["dataset"], request["batch_size"]),
        policy="MlpPolicy",
        rl_kwargs={
            "learning_rate": request["learning_rate"],
            "batch_size": request["batch_size"],
            "gamma": request["discount"],
            "tau": request["polyak"],
            "target_update_interval": 1,
            "train_freq": 1,
            "buffer_size": 10_000,
            "policy_kwargs": {"net_arch": request["hidden"]},
            "seed": request["seed"],
            "device": "cpu",
        },
    )
    trained.train(total_timesteps=request["updates"])

    def greedy(observation: torch.Tensor) -> torch.Tensor:
        values = trained.policy.q_net(observation)
        return torch.nn.functional.one_hot(values.argmax(dim=1), values.shape[1])

    return greedy


def demonstrations(world: Any, number: int, batch: int) -> Transitions:
    """Return a set of demonstrations as the library's own type.

    A set smaller than a batch, which the library refuses, is repeated.
    """
    action = world[f"action_{number}"]
    rows = np.tile(np.arange(len(action)), -(-batch // len(action)))
    return Transitions(
        obs=world[f"observation_{number}"][rows],
        acts=action[rows].astype(np.int64),
        infos=np.array([{}] * len(rows)),
        next_obs=world[f"next_observation_{number}"][rows],
        dones=(world[f"ending_{number}"] != NONE)[rows],
    )


def main(folder: Path) -> None:
    """Train every request, and write its table."""
    world = dict(np.load(folder / "world.npz"))
    made, seconds, updates = {}, 0.0, 0
    for number, request in enumerate(json.loads((folder / "requests.json").read_text())):
        np.random.seed(request["seed"])  # noqa: NPY002 - the library draws from it
        torch.manual_seed(request["seed"])
        train = train_sqil if request["learner"] == "sqil" else train_adversarial
        began = time.perf_counter()
        policy = train(world, request)
        seconds += time.perf_counter() - began
        updates += request["updates"]
        with torch.no_grad():
            table = policy(torch.as_tensor(world["observation"])).numpy()
        for place in range(len(request["weights"])):
            made[f"policy_{number}_{place}"] = table
    np.savez(folder / "policies.npz", updates_per_second=updates / seconds, **made)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
