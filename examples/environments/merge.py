"""highway-env's merge with a reward pair of its own: collect, mix, train, evaluate.

The ego drives on a motorway's right lane where a vehicle comes in from a ramp. r_env pays for speed,
r_social for how fast the others may drive, beside the speed that each of them wants.

    pip install 'socialiq[highway]'
    python examples/environments/merge.py --episodes 30 --updates 2000
"""

import argparse

import gymnasium
import highway_env  # noqa: F401  registers merge-v0
import numpy as np

import socialiq

CONFIG = {"simulation_frequency": 5}  # Hz; a third of the default, so three times as fast
LANE_LEFT, IDLE, LANE_RIGHT, FASTER, SLOWER = range(5)


def pair(step: socialiq.Transition) -> tuple[float, float]:
    """r_env: how near the speed is to 30 m/s; r_social: what the others lack of their own."""
    env = step.env.unwrapped
    others = [one for one in env.road.vehicles if one is not env.vehicle]
    braking = sum(max(0.0, -one.action["acceleration"]) for one in others) / 5
    struck = 5.0 * env.vehicle.crashed
    return (env.vehicle.speed - 20) / 10 - struck, -braking - struck


def ending(step: socialiq.Transition) -> str:
    """A crash, or the end of the road."""
    return "collision" if step.env.unwrapped.vehicle.crashed else "arrival"


def make() -> socialiq.RewardPairWrapper:
    """The environment, for `--world examples/environments/merge.py:make` too."""
    env = gymnasium.make("merge-v0", config=CONFIG)
    return socialiq.RewardPairWrapper(gymnasium.wrappers.TimeLimit(env, 40), pair, ending)


def pushy(observations: np.ndarray) -> list[int]:
    """Always faster."""
    return [FASTER for _ in observations]


def polite(observations: np.ndarray) -> list[int]:
    """Always slower."""
    return [SLOWER for _ in observations]
