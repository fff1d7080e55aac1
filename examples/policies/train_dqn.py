"""Trains the example of a Stable-Baselines3 policy: a DQN on highway-env's own intersection.

The real simulator and the real learner, with highway-env's own reward; only the observation and
the actions are those of `socialiq`'s intersection, so that the policy can be audited there.

    pip install 'socialiq-lab[sb3]'
    python examples/policies/train_dqn.py examples/policies/dqn_intersection.zip
"""

from __future__ import annotations

import sys

import torch
from highway_env.envs.intersection_env import IntersectionEnv
from stable_baselines3 import DQN

from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.reference import environment_config

SEED = 0
STEPS = 8_000


def main(path: str) -> None:
    """Train for `STEPS` decisions and write Stable-Baselines3's zip."""
    torch.set_num_threads(1)
    model = DQN(
        "MlpPolicy",
        IntersectionEnv(config=environment_config(Options())),
        policy_kwargs={"net_arch": [64, 64]},
        learning_rate=5e-4,
        buffer_size=STEPS,
        learning_starts=500,
        gamma=0.95,
        target_update_interval=250,
        exploration_fraction=0.5,
        seed=SEED,
        device="cpu",
    )
    model.learn(STEPS)
    model.save(path)


if __name__ == "__main__":
    main(*sys.argv[1:])
