"""The page's episode in which an altruist that doesn't weigh people obstructs them.

`python -m tests.page_core.people --out FILE` chooses it, by the dial of `crosswalk-intersection`.
"""

from pathlib import Path

import numpy as np
import tyro

from socialiq.evaluation.simulate import actor_of
from socialiq.nn.class_dial import ClassDial
from socialiq.storage import packaged_results, write_json
from socialiq.types import Ending
from socialiq.worlds.registry import make

DIAL = "crosswalk-intersection/dial.safetensors"
ANGLE, CLASS_ANGLES = 90.0, (0.0, 90.0)


def driven(class_angle: float, seeds: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Drive the dial at `ANGLE` and a class angle, an episode for each seed.

    Returns:
        Decisions (step, episode), -1 after the end; the seconds that people on foot wait for the
        car, and the ending, of each episode.
    """
    batch, dial = (
        make("intersection", people=0.1, cyclists=0.1).batch(len(seeds)),
        ClassDial.load(packaged_results() / DIAL),
    )
    batch.reset(seeds)
    actor = actor_of(batch, dial.of_class(class_angle).at(ANGLE))
    actor.begin(np.arange(len(seeds)), seeds)
    actions, waited, ending = list[np.ndarray](), np.zeros(len(seeds)), np.zeros(len(seeds), int)
    while (running := batch.running.copy()).any():
        chosen = np.broadcast_to(actor.decide(batch.observation, running), len(seeds))
        made = batch.step(chosen, auto_reset=False, rows=running)
        waited[running] += made.signals["pedestrian_delay"][running]
        ending[running] = made.ending[running]
        actions.append(np.where(running, chosen, -1))
    return np.stack(actions), waited, ending


def main(out: Path, episodes: int = 500) -> None:
    """Write the episode in which people wait longest for the first car, and the second arrives.

    The first does not collide.

    Args:
        out: File to write.
        episodes: Number of episodes among which is chosen, seeds 1 ff.
    """
    seeds = np.arange(1, episodes + 1)
    runs = [driven(class_angle, seeds) for class_angle in CLASS_ANGLES]
    (_, waited, ending), (*_, ending_of_second) = runs
    shown = (ending != Ending.COLLISION) & (ending_of_second == Ending.ARRIVAL)
    number = int(np.where(shown, waited, -np.inf).argmax())
    drivers = [
        {"class_angle": b, "actions": actions[actions[:, number] >= 0, number].tolist()}
        for b, (actions, *_) in zip(CLASS_ANGLES, runs, strict=True)
    ]
    write_json(out, {"seed": int(seeds[number]), "angle": ANGLE, "drivers": drivers})


if __name__ == "__main__":
    tyro.cli(main)
