"""The driver in every situation, beside dials that know one world each, and rules.

All drive the same fresh episodes. The world without the ego shows what it costs others
(`evaluation.effects`). Behind faults of sensors every driver has the front end that knows them.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.driver_training.mixture import FIRST_HELD_OUT, held_out, world_of_seed
from socialiq.evaluation.simulate import observations_of
from socialiq.nn.class_dial import ClassDial
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.nn.saved import FORMS
from socialiq.nn.unlikeness import Unlikeness
from socialiq.population import fleet
from socialiq.results_folder import as_csv, from_csv
from socialiq.social.angle import exact_weights, score
from socialiq.storage import kind_of, packaged_results, write_atomically
from socialiq.types import RewardPair, Row
from socialiq.worlds.highway.generated import Layout
from socialiq.worlds.registry import make
from socialiq.worlds.road_users import ROAD_USERS
from socialiq_lab.intersection.driving import DIAL, seeds_of_blocks, shipped_dials
from socialiq_lab.intersection.effects import EffectsRun, effects_of, measure_effects
from socialiq_lab.jobs import Inputs, Job, ProgressCallback
from socialiq_lab.study import Context, Findings
from socialiq_lab.tables import groups, labelled, numeric_means

DRIVER = "driver"
DIALS = {
    "eq_4_2": "intersection-dial-clock/iterated.safetensors",
    "effects": "caused-effects/dial.safetensors",
    "shifts": "compare-shifts/randomised-200.safetensors",
    "crosswalk": "crosswalk-intersection/dial.safetensors",
    "fleet": "population/dial.safetensors",
    "offline": "intersection-offline/dial.safetensors",
}
"""Dials of the committed results, each for one world, by what they were trained for."""
FAULTS = "shift=[latency=1,unseen=.3,noise=1]"
SITUATIONS = {
    "plain": "intersection",
    "faults": f"intersection,{FAULTS}",
    "right": "intersection,exit=right",
    "straight": "intersection,exit=straight",
    "connected": "intersection,connected",
    "dense": "intersection,dense",
    "wet": "intersection,wet",
    "crosswalk": "intersection,people=.1",
    "crosswalk_faults": f"intersection,people=.1,{FAULTS}",
    "cyclists": "intersection,people=.1,cyclists=.1",
    "merge": "merge",
    "roundabout": "roundabout",
    "two_way": "two_way",
}
ROUTE = ",observation=route"
OWN_EXIT = {"shifts": "+known,exit=own"}
"""Front end of dials that were trained behind one."""
HITS = tuple(f"signal_{user.name}_hit" for user in ROAD_USERS)
MEASURES = ("r_env", "r_eq_4_2", "r_caused", "delay", "arrival", "collision", *HITS)
KINDS = {
    "training": "road",
    "held out": "road",
    "crossings of 30 degrees": "road,shape=crossing,skew=30",
    "roundabouts of five arms": "road,shape=roundabout,arms=5",
}
"""Generated roads by kind: only the seeds of the first kind are of training."""
FLEETS = "fleets.csv"
ALARMS = "alarms.csv"
FIRST_WORLD = 2**62
"""First seed of the mixture's worlds to which the score of unlikeness is fitted."""


def turns(config: Any, name: str, world: str) -> tuple[str, ...]:
    """Return what follows the file of a dial, for each angle.

    Args:
        config: Configuration of the study.
        name: Name of the dial.
        world: World in which it drives.
    """
    file = packaged_results() / ({DRIVER: config.driver} | DIALS)[name]
    class_angle = config.class_angle if make(world).walks else 0.0
    second = f"/{class_angle:g}" if kind_of(file) == ClassDial.KIND else ""
    front_end = "" if name == DRIVER else OWN_EXIT.get(name, _known(world))
    return tuple(f"@{angle:g}{second}{front_end}" for angle in config.angles)


def fitting(config: Any, world: str) -> list[str]:
    """Return the names of the dials that can drive at an intersection.

    Args:
        config: Configuration of the study.
        world: The intersection; the dial `crosswalk` observes the rows of people.
    """
    return [name for name in config.dials if name != "crosswalk" or make(world).walks]


def _known(world: str) -> str:
    """Return the front end of a driver where sensors have faults."""
    return "+known" if "shift=" in world else ""


def runs(config: Any) -> Iterator[tuple[str, str, EffectsRun]]:
    """Yield situation, driver and episodes of the driver, each dial, and the rules together."""
    seeds = seeds_of_blocks((config.first_episode,), config.episodes)
    for situation in (*config.intersections, *config.others):
        world = SITUATIONS[situation]
        front_end = ",front_end=known" if _known(world) else ""
        shown = f"{world}{front_end}{ROUTE}"
        yield situation, DRIVER, EffectsRun(turns(config, DRIVER, world), MEASURES, seeds, shown)
        for name in fitting(config, world) if situation in config.intersections else ():
            yield situation, name, EffectsRun(turns(config, name, world), MEASURES, seeds, world)
        known = [rule for rule in config.rules if rule in make(world).drivers]
        rules = tuple(f"{rule}{_known(world)}" for rule in known)
        yield situation, "rules", EffectsRun(rules, MEASURES, seeds, world)


def roads(config: Any) -> Iterator[tuple[str, str]]:
    """Yield kind and text of each generated road."""
    for kind, world in KINDS.items():
        seed = 0 if kind == "training" else FIRST_HELD_OUT
        remaining = config.roads
        while remaining:
            if kind.startswith("round") or not held_out(Layout.of_seed(seed)):
                yield kind, f"{world},seed={seed}"
                remaining -= 1
            seed += 1


@dataclass(frozen=True)
class Meeting:
    """Fleets in which every agent is the same dial."""

    world: str
    angles: tuple[float, ...]
    seeds: tuple[int, ...]


def meet(config: Meeting, folder: Path, inputs: Inputs, _on_progress: ProgressCallback) -> None:
    """Drive fleets of one dial at each angle, and write a row for each.

    Args:
        config: World of several agents, angles in degrees, and seeds.
        folder: Folder of the job, to which the rows are written.
        inputs: Folder of the job with the dial.
    """
    (trained,) = inputs.values()
    dial: Any = FORMS[kind_of(trained / DIAL)].load(trained / DIAL)
    turned: DialPolicy = dial.of_class(0.0) if isinstance(dial, ClassDial) else dial
    policies = {angle: turned.at(angle) for angle in config.angles}
    world: Any = make(config.world)
    uniform = fleet.uniform_fleets(world, policies, np.array(config.seeds))
    rows = [{"angle": angle, **fleet.summary(group, 0)} for angle, group in uniform.items()]
    write_atomically(folder / FLEETS, as_csv(rows))


@dataclass(frozen=True)
class UnlikenessRun:
    """Worlds of training that the score of unlikeness is fitted to, and those that it is asked in.

    One half of the worlds of training fits mean and covariance, the other one the threshold.
    """

    angle: float
    training: tuple[str, ...]
    asked: tuple[str, ...]
    seeds: tuple[int, ...]


def unlikeness(
    config: UnlikenessRun, folder: Path, inputs: Inputs, _on_progress: ProgressCallback
) -> None:
    """Write the share of decisions that are unlike training for each world.

    Args:
        config: Worlds, and seeds of their episodes.
        folder: Folder of the job, to which the rows are written.
        inputs: Folder of the job with the dial.
    """
    (trained,) = inputs.values()
    policy = ClassDial.load(trained / DIAL).of_class(0.0).at(config.angle)
    half = len(config.training) // 2
    of_training = [_features(policy, world, config.seeds) for world in config.training]
    fitted, held = (np.concatenate(part) for part in (of_training[:half], of_training[half:]))
    score_of = Unlikeness.fit(fitted, held)
    rows = []
    for world in config.asked:
        distances = score_of(_features(policy, world, config.seeds))
        rows.append({"world": world, "alarms": float((distances > 1.0).mean())})
    write_atomically(folder / ALARMS, as_csv(rows))


def _features(policy: QPolicy, world: str, seeds: tuple[int, ...]) -> np.ndarray:
    """Return what the last hidden layer makes of each decision in a world."""
    batch = make(world).batch(len(seeds))
    return policy.features(observations_of(batch, policy, seeds))


def unlikeness_run(config: Any) -> UnlikenessRun:
    """Return the worlds of the score: situations without people, and roads of each kind."""
    worlds = map(world_of_seed, range(FIRST_WORLD, FIRST_WORLD + 100 * config.training_worlds))
    training = [world for world in worlds if "agents" not in world][: config.training_worlds]
    situations = [SITUATIONS[name] for name in (*config.intersections, *config.others)]
    asked = [world for world in situations if not (make(world).walks or _known(world))]
    asked += [world for _, world in roads(config)]
    seeds = seeds_of_blocks((config.first_episode,), config.unlikeness_episodes)
    return UnlikenessRun(45.0, tuple(training), tuple(world + ROUTE for world in asked), seeds)


def jobs(config: Any) -> list[Job]:
    """Return the jobs: dials, situations, generated roads, fleets, unlikeness."""
    listed = shipped_dials({DRIVER: config.driver} | {name: DIALS[name] for name in config.dials})
    for situation, name, run in runs(config):
        inputs = () if name == "rules" else (f"dials/{name}",)
        listed.append(Job(f"situations/{situation}/{name}", measure_effects, run, inputs, 60.0))
    seeds = seeds_of_blocks((config.first_episode,), config.road_episodes)
    turned = turns(config, DRIVER, "road")
    for number, (_, world) in enumerate(roads(config)):
        run = EffectsRun(turned, MEASURES, seeds, world + ROUTE)
        listed.append(Job(f"roads/{number}", measure_effects, run, (f"dials/{DRIVER}",), 20.0))
    seeds = seeds_of_blocks((config.first_episode,), config.fleet_episodes)
    for name in (DRIVER, *fitting(config, "intersection")):
        world = f"intersection,agents={config.fleet},duration={fleet.DURATION:g}"
        meeting = Meeting(world + ROUTE * (name == DRIVER), config.angles, seeds)
        listed.append(Job(f"fleets/{name}", meet, meeting, (f"dials/{name}",), 60.0))
    listed.append(
        Job("unlikeness", unlikeness, unlikeness_run(config), (f"dials/{DRIVER}",), 120.0)
    )
    return listed


def _means(episodes: np.ndarray, angle: float) -> Row:
    """Return means over episodes, (episode, measure): J(α) of both rewards, shares, metres."""
    row = dict(zip(MEASURES, episodes.mean(axis=0).tolist(), strict=True))
    row["hit"] = sum(row.pop(name) for name in HITS)
    row["collision"] += row["hit"]
    values = {
        name: float(score(exact_weights(angle), RewardPair(row["r_env"], row[social])))
        for name, social in (("value", "r_eq_4_2"), ("value_caused", "r_caused"))
    }
    return values | row


def compute_tables(config: Any, context: Context) -> Findings:
    """Return every driver in every situation, the driver on generated roads, and fleets.

    Args:
        config: Configuration of the study.
        context: Finished jobs and their work folder.

    Returns:
        Tables `situations`, `roads`, `every_road`, `fleets` and `unlikeness`; for each driver the
        mean share of collisions over the intersections at each angle as summary; and the driver.
    """
    situations = list[Row]()
    for situation, name, run in runs(config):
        driven = effects_of(context.work / f"situations/{situation}/{name}")
        for number in range(len(run.drivers)):
            is_rule = name == "rules"
            driver = run.drivers[number].partition("+")[0] if is_rule else name
            for angle in config.angles if is_rule else (config.angles[number],):
                row: Row = {"situation": situation, "driver": driver, "angle": angle}
                situations.append(row | _means(driven[number, 0], angle))
    of_roads = list[Row]()
    for number, (kind, world) in enumerate(roads(config)):
        driven = effects_of(context.work / f"roads/{number}")
        for angle, episodes in zip(config.angles, driven[:, 0], strict=True):
            of_roads.append({"kind": kind, "road": world, "angle": angle} | _means(episodes, angle))
    tables = {
        "situations": situations,
        "roads": [
            label
            | numeric_means([{k: v for k, v in row.items() if k != "road"} for row in rows])
            | {"collision_worst": max(row["collision"] for row in rows)}
            for label, rows in labelled(of_roads, "kind", "angle")
        ],
        "every_road": of_roads,
        "fleets": [
            {"driver": name} | row
            for name in (DRIVER, *fitting(config, "intersection"))
            for row in from_csv(context.work / f"fleets/{name}" / FLEETS)
        ],
        "unlikeness": from_csv(context.work / "unlikeness" / ALARMS),
    }
    at_intersections = [row for row in situations if row["situation"] in config.intersections]
    summary: dict[str, Any] = {
        f"collision_{driver}_{angle:g}": float(np.mean([row["collision"] for row in rows]))
        for (driver, angle), rows in groups(at_intersections, "driver", "angle").items()
    }
    driver = (context.work / f"dials/{DRIVER}" / DIAL).read_bytes()
    return Findings(tables, summary, {Path(config.driver).name: driver})
