"""Jobs of the study of other roads; each fills a folder."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.demonstrations import files
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.demonstrations.mixture import equal_trajectories
from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.evaluation.play import record
from socialiq.learners.dial import config as dial
from socialiq.learners.dial import train as dial_training
from socialiq.learners.dial.acting import DialCollector
from socialiq.learners.dqn import config as dqn
from socialiq.learners.dqn import train as dqn_training
from socialiq.learners.iq_learn import config as iq
from socialiq.learners.iq_learn.train import train as train_iq
from socialiq.nn.dial_network import DialNetwork, transferred
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_network import network_of
from socialiq.nn.q_policy import QPolicy
from socialiq.social.angle import exact_weights
from socialiq.storage import packaged_results, write_json
from socialiq.types import Ending, Policy, Row
from socialiq.worlds.highway.scene import ACTIONS
from socialiq.worlds.highway.world import SceneWorld, world_of
from socialiq.worlds.intersection.state import ACTIONS as CROSSING_ACTIONS
from socialiq_lab.intersection.fitting import CHUNK, Monitor, fit, road_source
from socialiq_lab.intersection.training import STEPS_PER_UPDATE
from socialiq_lab.jobs import ProgressCallback

DIAL, CHECKS = "dial.safetensors", 6
DRIVEN = "driven.json"
SIDE_BY_SIDE = 250
CHECK_EPISODES, FIRST_CHECK = 150, 64_500_000


@dataclass(frozen=True)
class Experts:
    """Three DQN experts of a road, in one program."""

    road: str
    structure: dqn.StaticConfig
    numbers: tuple[dqn.Hyperparameters, ...]
    environments: int = 12


def train_experts(
    config: Experts, folder: Path, _inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write the three experts after their last update."""
    world = world_of(config.road)
    structure = config.structure
    sources = [
        road_source(world, config.environments, structure.steps_per_update) for _ in config.numbers
    ]
    sizes = (world.n_features, world.n_actions)
    train = partial(dqn_training.train, structure, config.numbers, sources, sizes)
    fit(train, folder, on_progress, [f"{mode}.safetensors" for mode in MODES])


@dataclass(frozen=True)
class Recording:
    """Greedy episodes of each expert."""

    road: str
    first_seed: int
    episodes: int


def record_experts(
    config: Recording, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write the mixture of all three experts' episodes."""
    (trained,) = inputs.values()
    world, pools = world_of(config.road), {}
    for number, mode in enumerate(MODES):
        policy = QPolicy.load(trained / f"{mode}.safetensors")
        first = config.first_seed + number * config.episodes
        seeds = np.arange(first, first + config.episodes)
        source = {"world": world.description, "expert": dict(policy.provenance)}
        batch = world.batch(min(config.episodes, SIDE_BY_SIDE))
        pools[mode] = record(batch, policy, seeds, mode, source).transitions
        on_progress((number + 1) / len(MODES))
    mixed = equal_trajectories(pools, config.episodes, config.first_seed)
    files.save(folder / "mixture.safetensors", mixed)


def _mixture(inputs: Mapping[str, Path]) -> Demonstrations:
    (recorded,) = inputs.values()
    return files.load(recorded / "mixture.safetensors")


@dataclass(frozen=True)
class Trio:
    """Offline IQ-Learn with the social prior at each mode's angle, in one program."""

    road: str
    structure: iq.StaticConfig
    numbers: iq.Hyperparameters


def train_trio(
    config: Trio, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write one policy for each mode."""
    runs = [dataclasses.replace(config.numbers, angle=angle) for angle in MODES.values()]
    train = partial(train_iq, config.structure, runs, [_mixture(inputs)])
    fit(train, folder, on_progress, [f"{mode}.safetensors" for mode in MODES])


@dataclass(frozen=True)
class RoadDial:
    """A dial of a road, on the mixture and on the core."""

    road: str
    structure: dial.StaticConfig
    numbers: dial.Hyperparameters
    from_intersection: bool
    """Whether it begins with the intersection's dial."""


def train_dial(
    config: RoadDial, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write a dial, and its mean J(α) over the modes' angles at some updates."""
    world = world_of(config.road)
    structure, numbers = config.structure, config.numbers
    source = road_source(world, structure.environments, STEPS_PER_UPDATE)
    train = partial(
        dial_training.train,
        structure,
        [numbers],
        [_mixture(inputs)],
        sizes=(world.n_features, world.n_actions),
        before_chunk=DialCollector([source], structure, [numbers]),
        start=begun(world) if config.from_intersection else None,
    )
    fit(train, folder, on_progress, [DIAL], _checks(world, config))


def begun(world: SceneWorld) -> DialNetwork:
    """Return the intersection's committed dial as the network of a road."""
    made = DialPolicy.load(packaged_results() / "intersection-dial" / DIAL)
    rows = world.options.observed_vehicles
    return transferred(made.network(), CROSSING_ACTIONS, ACTIONS, "idle", rows)


def _checks(world: SceneWorld, config: RoadDial) -> Monitor:
    """Return a monitor of J(α), the mean over the modes' angles, `CHECKS` times in a run."""
    structure, numbers = config.structure, config.numbers
    chunks = -(-structure.updates // CHUNK)
    due = {chunks * check // CHECKS for check in range(1, CHECKS + 1)}
    seeds = np.arange(FIRST_CHECK, FIRST_CHECK + CHECK_EPISODES)

    def after_chunk(state: Any) -> dict[str, np.ndarray]:
        if -(-int(state.optimiser.count[0]) // CHUNK) not in due:
            return {"total": np.array([np.nan])}
        network = network_of(dial_training.deployed(state), 0)
        policy = dial_training.dial_of(structure, numbers, network)
        found = [outcome(world, policy.at(angle), seeds, angle) for angle in MODES.values()]
        return {"total": np.array([np.mean([one["score"] for one in found])])}

    return after_chunk


@dataclass(frozen=True)
class Drive:
    """Greedy episodes of every policy of a road."""

    road: str
    first_seed: int
    episodes: int


def drive(
    config: Drive, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write a row for each policy and angle; of a pair's episodes all have the same seeds."""
    world = world_of(config.road)
    experts, trio, scratch, tuned = inputs.values()
    seeds = np.arange(config.first_seed, config.first_seed + config.episodes)
    as_it_is = DialPolicy.of(begun(world), 1.0, 0.0, 90.0, {})
    dials = {
        "dial": DialPolicy.load(scratch / DIAL),
        "intersection's dial, as it is": as_it_is,
        "intersection's dial, fine-tuned": DialPolicy.load(tuned / DIAL),
    }
    rows: list[Row] = []
    for mode, angle in MODES.items():
        policies: dict[str, Policy] = {
            "expert": QPolicy.load(experts / f"{mode}.safetensors"),
            "trio": QPolicy.load(trio / f"{mode}.safetensors"),
            **{name: one.at(angle) for name, one in dials.items()},
        }
        for name, policy in policies.items():
            found = outcome(world, policy, seeds, angle)
            rows.append({"road": config.road, "policy": name, "angle": angle} | found)
        on_progress(len(rows) / (len(MODES) * 5))
    write_json(folder / DRIVEN, {"rows": rows})


def outcome(world: SceneWorld, policy: Policy, seeds: np.ndarray, angle: float) -> dict[str, float]:
    """Return means over greedy episodes, and the standard error of the score J(α).

    Args:
        world: The road.
        policy: The policy.
        seeds: Seed of each episode.
        angle: α of the score, in degrees.
    """
    made = record(world.batch(min(len(seeds), SIDE_BY_SIDE)), policy, seeds, "driven").transitions
    env, social = (np.bincount(made.episode, values) for values in made.rewards)
    last = made.ending[made.ending != int(Ending.NONE)]
    along = exact_weights(angle)
    score = along.env * env + along.social * social
    return {
        "r_env": float(env.mean()),
        "r_social": float(social.mean()),
        "score": float(score.mean()),
        "score_error": float(score.std(ddof=1) / np.sqrt(len(seeds))),
        "collision": float((last == int(Ending.COLLISION)).mean()),
        "arrival": float((last == int(Ending.ARRIVAL)).mean()),
        "decisions": len(made.ending) / len(seeds),
    }
