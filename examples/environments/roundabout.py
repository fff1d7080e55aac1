"""highway-env's roundabout with a reward pair of its own: collect, mix, train, evaluate.

The ego wants to enter a roundabout in which four others drive. r_env pays for its speed, r_social
for every vehicle that has to brake. To run it takes highway-env: pip install 'socialiq[highway]'
"""

import argparse
from typing import Any

import gymnasium
import highway_env  # noqa: F401  registers roundabout-v0
import numpy as np

import socialiq
from socialiq import RewardPairWrapper, Transition

CONFIG = {"simulation_frequency": 5}  # Hz; a third of the default, so about three times as fast
FASTER, SLOWER = 3, 4
ANGLES = (0.0, 45.0, 90.0)  # degrees
ENTRY, RING = 25.0, 15.0  # m: where the ego enters, and how near to that another vehicle counts


def pair(step: Transition) -> tuple[float, float]:
    """Speed as a share of the fastest; braking of all others in units of 5 m/s²; -1 for a crash."""
    env: Any = step.env.unwrapped
    others = [vehicle for vehicle in env.road.vehicles if vehicle is not env.vehicle]
    braking = sum(max(0.0, -vehicle.action["acceleration"]) for vehicle in others) / 5
    return env.vehicle.speed / 16 - env.vehicle.crashed, -braking - env.vehicle.crashed


def ending(step: Transition) -> str:
    """The only terminal states are crashes and leaving the road; 11 s truncate the episode."""
    env: Any = step.env.unwrapped
    return "collision" if env.vehicle.crashed else "other"


def make() -> RewardPairWrapper:
    """The environment; also what `--world examples/environments/roundabout.py:make` names."""
    return RewardPairWrapper(gymnasium.make("roundabout-v0", config=CONFIG), pair, ending)


def pushy(observations: np.ndarray) -> np.ndarray:
    """Enters whatever comes."""
    return np.full(len(observations), FASTER)


def polite(observations: np.ndarray) -> np.ndarray:
    """Waits before the ring while a vehicle is near the place where it would enter."""
    seen = observations.reshape(len(observations), -1, 5).astype(np.float64)
    place = seen[..., 1:3] * 100  # m; y falls towards the ring
    near = np.hypot(place[:, 1:, 0], place[:, 1:, 1] - ENTRY) < RING
    wait = (place[:, 0, 1] > ENTRY) & (near & (seen[:, 1:, 0] > 0)).any(axis=1)
    return np.where(wait, SLOWER, FASTER)


def main(episodes: int, updates: int, seeds: int) -> list[dict]:
    """Collect from both drivers, train at three angles, and measure all five."""
    world = f"{__file__}:make"
    own: dict[str, Any] = {"allow_code": True}
    drivers = {name: f"python:{__file__}:{name}" for name in ("pushy", "polite")}
    mixed = socialiq.collect(world, drivers, episodes=episodes, **own)
    settings: dict[str, Any] = {"value_term": "value_expert", "strength": 3.0, "updates": updates}
    policies = socialiq.train("iq-learn", mixed, angle=ANGLES, seed=range(seeds), **settings)
    how: dict[str, Any] = {"episodes": episodes, "seed": 10_000, **own}
    rules = [socialiq.evaluate(driver, world, **how) for driver in drivers.values()]
    rows = [{"driver": name, **rule} for name, rule in zip(drivers, rules, strict=True)]
    for row in socialiq.evaluate(policies, world, **how).table:
        name = f"{row['trained_angle']:g}, seed {row['training_seed']}"
        rows.append({"driver": name, **row})
    return rows


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    for option, default in (("--episodes", 20), ("--updates", 1000), ("--seeds", 1)):
        parser.add_argument(option, type=int, default=default)
    for row in main(**vars(parser.parse_args())):
        measured = " ".join(
            f"{key} {row[key]:6.2f}" for key in ("r_env", "r_social", "collision", "mean_speed")
        )
        print(f"{row['driver']:12} {measured}")
