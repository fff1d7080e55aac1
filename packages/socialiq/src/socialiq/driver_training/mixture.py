"""Worlds in which the driver is trained, drawn from seeds as texts of the grammar of worlds.

Half of them are generated roads, the rest are highway-env's intersection, merge and roundabout. A
world has its defaults or other traffic, people, faults behind a front end, or a fleet that the
driver drives against itself. r_social is what the ego causes; in a fleet, what its partners get.
"""

from __future__ import annotations

import numpy as np

from socialiq.worlds.highway.generated import Layout

SCENES = {"road": 0.5, "intersection": 0.25, "roundabout": 0.15, "merge": 0.1}
"""Probability of each scene."""

DURATION = {"road": 30.0, "intersection": 20.0, "roundabout": 11.0, "merge": 40.0}
"""Seconds of each scene's episodes."""

AFTER = 5.0
"""Seconds after the end of an episode's time for which its effects are measured: until wrecks are
towed. The default of `reward=caused`, half of the duration, would cost a third of the labels."""

FIRST_HELD_OUT = 1_000_000
"""First seed of generated roads that training never draws."""

FLEETS = 0.12
PEOPLE = 0.5
CYCLISTS = 0.5  # of the roads with people and bicycle lanes
FAULTS = 0.4
LEFT_HAND = 0.15
WET = 0.1
USUAL = 0.5  # of each group of options that the world's defaults stay

FASTEST = (6.0, 7.5, 10.5, 12.0)  # m/s
DURATIONS = (15.0, 25.0, 40.0)  # s
_FAULTS = {
    "latency=1": 0.4,
    "unseen=.3": 0.35,
    "noise=1": 0.25,
    "noise=3": 0.15,
    "sight=40": 0.15,
    "occlusion=true": 0.15,
}


def held_out(layout: Layout) -> bool:
    """Return whether training draws no road of a layout: roundabouts of five arms.

    Args:
        layout: Layout of a generated road.
    """
    return layout.form == "roundabout" and layout.arms == 5


def world_of_seed(seed: int) -> str:
    """Return the world of training that a seed draws, as text.

    Args:
        seed: Seed of the draws, at least 0.
    """
    rng = np.random.default_rng(seed)
    scene = str(rng.choice(list(SCENES), p=list(SCENES.values())))
    words = [scene, "observation=route"]
    duration = DURATION[scene]
    rides = scene == "intersection"
    if scene == "road":
        road_seed = _road_seed(rng)
        layout = Layout.of_seed(road_seed)
        rides = layout.form == "crossing" and layout.arms == 4
        words.append(f"seed={road_seed}")
    if scene in ("road", "intersection"):
        words.append("exit=random")
        if rng.random() > USUAL:
            duration = float(rng.choice(DURATIONS))
            words.append(f"duration={duration:g}")
        words += _traffic(rng)
        if rng.random() < PEOPLE:
            words.append("people=.1")
            if rides and rng.random() < CYCLISTS:
                words.append("cyclists=.1")
        if rng.random() < FLEETS:
            return ",".join([*words, "agents=4"])
    words += ["reward=caused", f"horizon={duration + AFTER:g}"]
    if rng.random() < LEFT_HAND:
        words.append("left_hand=true")
    faults = [word for word, chance in _FAULTS.items() if rng.random() < chance]
    if faults and rng.random() < FAULTS:
        words += [f"shift=[{','.join(_distinct(faults))}]", "front_end=known"]
    return ",".join(words)


def _road_seed(rng: np.random.Generator) -> int:
    """Return the seed of a generated road that is not held out."""
    while True:
        seed = int(rng.integers(FIRST_HELD_OUT))
        if not held_out(Layout.of_seed(seed)):
            return seed


def _traffic(rng: np.random.Generator) -> list[str]:
    """Return options of speed and other drivers, each group by its defaults or drawn."""
    words = []
    if rng.random() > USUAL:
        fastest = rng.choice(FASTEST)
        words.append(f"target_speeds=[0,{fastest / 2:g},{fastest:g}]")
    if rng.random() > USUAL:
        words.append(f"initial_vehicle_count={rng.integers(3, 11)}")
        words.append(f"spawn_probability={rng.uniform(0.1, 0.6):.2f}")
    if rng.random() > USUAL:
        connected = "true" if rng.random() < 0.5 else "false"
        words.append(f"connected_lanes={connected}")
    if rng.random() < WET:
        words.append("wet=true")
    elif rng.random() > USUAL:
        words.append("population=thesis")
    return words


def _distinct(faults: list[str]) -> list[str]:
    """Return faults of which each is given once, the last value of each."""
    return list({word.partition("=")[0]: word for word in faults}.values())
