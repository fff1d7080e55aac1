"""PPO of Stable-Baselines3, one network for all agents (IPPO), beside the dial of self-play.

    pip install 'socialiq[pettingzoo]' 'socialiq-lab[sb3]'
    python benchmarks/peers/fleet_peer.py peers.csv [STEPS ...]

Eight agents at the intersection through PettingZoo and SuperSuit, one network for each angle. An
agent gets its own r_env and, for the social part, the sum of the others' while it drives, as in
self-play. By default PPO takes as many steps as self-play labelled states; steps of agents that
ended before the last one count. It is then driven on the episodes of the study `population`.
"""

# These libraries are in the extras alone.
# pyright: reportMissingImports=false

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import supersuit
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.utils import set_random_seed

from socialiq.evaluation.road_training import CHUNK
from socialiq.policies.load import load_policy
from socialiq.population import fleet
from socialiq.results_folder import as_csv
from socialiq.social.angle import weights
from socialiq.storage import write_atomically
from socialiq.to_json import rounded
from socialiq.worlds.parallel import RoadParallelEnv
from socialiq.worlds.registry import make_fleet
from socialiq_lab.intersection.driving import seeds_of_blocks
from socialiq_lab.registry import find

ANGLES, SEED, EPISODES = (0.0, 45.0, 75.0), 0, 8
STUDY = find("population").Config()
LABELS = (STUDY.updates + CHUNK) * STUDY.states_per_update
"""States that self-play labels: of its updates, and of one round more before the first."""


class OthersRewarded(RoadParallelEnv):
    """The fleet of the study, with the sum of the others' r_env as the social reward."""

    def __init__(self, angle: float) -> None:
        traffic: dict[str, Any] = {
            "spawn_probability": STUDY.spawn_probabilities[0],
            "duration": fleet.DURATION,
        }
        super().__init__(agents=STUDY.agents, clock=True, **traffic)
        self._pair = weights(angle)

    def step(self, actions):
        """Take one decision; see `RoadParallelEnv.step`."""
        observations, rewards, terminated, truncated, infos = super().step(actions)
        env = {agent: float(infos[agent]["reward_pair"][0]) for agent in rewards}
        total, (own, others) = sum(env.values()), self._pair
        rewards = {agent: own * env[agent] + others * (total - env[agent]) for agent in env}
        return observations, rewards, terminated, truncated, infos


def train(angle: float, steps: int, path: Path) -> None:
    """Train one network for all agents, with PPO's default settings but for sizes; save it."""
    torch.set_num_threads(1)
    rows = supersuit.pettingzoo_env_to_vec_env_v1(supersuit.black_death_v3(OthersRewarded(angle)))
    rows = supersuit.concat_vec_envs_v1(rows, EPISODES, base_class="stable_baselines3")
    rows.venv.reset(seed=SEED)
    set_random_seed(SEED)
    network = {"net_arch": [64, 64]}
    model = PPO("MlpPolicy", rows, n_steps=64, batch_size=512, policy_kwargs=network, device="cpu")
    model.learn(steps)
    model.save(path)


def main(out: str, *counts: str) -> None:
    """Train and drive each angle for each number of steps; write a row for each and density."""
    table, seeds = [], seeds_of_blocks(STUDY.blocks, STUDY.episodes)
    everybody = np.zeros((len(seeds), STUDY.agents), np.int64)
    for steps in map(int, counts or (LABELS,)):
        for angle in ANGLES:
            with tempfile.TemporaryDirectory() as place:
                path = Path(place) / "fleet.zip"
                train(angle, steps, path)
                for density in STUDY.spawn_probabilities:
                    traffic: dict[str, Any] = {
                        "spawn_probability": density,
                        "duration": fleet.DURATION,
                    }
                    world = make_fleet(agents=STUDY.agents, **traffic)
                    trained = load_policy(str(path), world.n_features + 1, world.n_actions).policy
                    label = {"steps": steps, "angle": angle, "spawn_probability": density}
                    driven = fleet.drive(world, [trained], everybody, seeds)
                    table.append(label | fleet.summary(driven, 0))
                    print(table[-1], flush=True)
    write_atomically(Path(out), as_csv(rounded(table)))


if __name__ == "__main__":
    main(*sys.argv[1:])
