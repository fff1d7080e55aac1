"""Trains one network for all vehicles of a fleet: PPO of Stable-Baselines3, through PettingZoo.

Four vehicles at the intersection, each with the reward R(α) at 45 degrees. SuperSuit makes the
agents of several episodes rows of one vector environment; those that have left see zeros.

    pip install 'socialiq[pettingzoo]' 'socialiq-lab[sb3]'
    python examples/policies/train_fleet.py fleet.zip
"""

from __future__ import annotations

import sys

import supersuit
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.utils import set_random_seed

from socialiq.evaluation.fleet import drive
from socialiq.policies.load import load_policy
from socialiq.types import Ending
from socialiq.worlds.parallel import RoadParallelEnv
from socialiq.worlds.registry import make_fleet

AGENTS, ANGLE, EPISODES, SEED = 4, 45.0, 8, 0


def main(path: str, steps: int = 200_000) -> None:
    """Train for so many decisions of agents, write the zip, and drive all agents by it."""
    torch.set_num_threads(1)
    fleet = supersuit.black_death_v3(RoadParallelEnv(agents=AGENTS, angle=ANGLE))
    rows = supersuit.pettingzoo_env_to_vec_env_v1(fleet)
    rows = supersuit.concat_vec_envs_v1(rows, EPISODES, base_class="stable_baselines3")
    rows.venv.reset(seed=SEED)  # later episodes continue these streams
    set_random_seed(SEED)
    policy = {"net_arch": [64, 64]}
    model = PPO("MlpPolicy", rows, n_steps=64, batch_size=512, policy_kwargs=policy, device="cpu")
    model.learn(steps)
    model.save(path)
    world = make_fleet(agents=AGENTS)
    trained = load_policy(path, world.n_features, world.n_actions).policy
    driven = drive(world.batch(200), [trained], 1_000_000)
    for ending in (Ending.ARRIVAL, Ending.COLLISION, Ending.TIMEOUT):
        print(f"{ending.name.lower()}: {100 * (driven.ending == ending).mean():.1f} %")


if __name__ == "__main__":
    main(*sys.argv[1:])
