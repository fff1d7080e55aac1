"""Configuration and jobs of the study of other roads."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from socialiq.errors import UserError, one_of
from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.learners.config import check_counts, check_seed
from socialiq.learners.dqn import config as dqn
from socialiq.learners.iq_learn import presets
from socialiq.worlds.highway.scenes import SCENES
from socialiq_lab.intersection.experts import finer
from socialiq_lab.intersection.training import DIAL_NUMBERS, DIAL_STRUCTURE
from socialiq_lab.jobs import Job
from studies.roads.work import (
    Drive,
    Experts,
    Recording,
    RoadDial,
    Trio,
    drive,
    record_experts,
    train_dial,
    train_experts,
    train_trio,
)

FROM_SCRATCH, FINE_TUNED = "from scratch", "fine-tuned"


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results.

    Sizes were chosen by time on training seed 100 and episodes from 50,000,000.
    """

    roads: tuple[str, ...] = SCENES
    """Scenes of `worlds.highway.scenes`."""
    seeds: tuple[int, ...] = (2300, 2301, 2302, 2303, 2304)
    """Training seeds; every network of a seed is trained with it."""
    expert_updates: int = 3000
    """Gradient steps of an expert."""
    pool: int = 300
    """Episodes recorded of each expert, all in the mixture."""
    trio_updates: int = 2000
    """Gradient steps of each learner of the trio."""
    dial_updates: int = 3000
    """Gradient steps of a dial, from scratch and fine-tuned."""
    episodes: int = 1000
    """Evaluation episodes of each policy, the same for all."""
    first_seed: int = 63_000_000
    """Seed of the first of these; demonstrations begin 1,000,000 later."""

    def __post_init__(self) -> None:
        """Refuse unknown roads and empty sizes."""
        for road in self.roads:
            one_of("road", road, SCENES)
        check_counts(self, ("expert_updates", "pool", "trio_updates", "dial_updates", "episodes"))
        check_seed(self.first_seed)
        if not self.roads or not self.seeds:
            raise UserError("name at least one road and one seed")


def plan(config: Config) -> list[Job]:
    """Return every job, each after its inputs."""
    return [
        job
        for road in config.roads
        for seed in config.seeds
        for job in _of_seed(config, road, seed)
    ]


def folder(road: str, seed: int, name: str) -> str:
    """Return the folder of a job."""
    return f"{road}/{seed}/{name.replace(' ', '-')}"


def _of_seed(config: Config, road: str, seed: int) -> Iterator[Job]:
    def job(name: str, work: Any, run: Any, *inputs: str, cost: float) -> Job:
        names = tuple(folder(road, seed, one) for one in inputs)
        return Job(folder(road, seed, name), work, run, names, cost=cost)

    yield job("experts", train_experts, _experts(config, road, seed), cost=60.0)
    recording = Recording(road, config.first_seed + 1_000_000, config.pool)
    yield job("demonstrations", record_experts, recording, "experts", cost=5.0)
    trio = dataclasses.replace(
        presets.offline(presets.INTERSECTION_CALIBRATED), updates=config.trio_updates
    )
    numbers = dataclasses.replace(presets.INTERSECTION_CALIBRATED_NUMBERS, seed=seed)
    yield job("trio", train_trio, Trio(road, trio, numbers), "demonstrations", cost=30.0)
    structure = dataclasses.replace(DIAL_STRUCTURE, updates=config.dial_updates)
    for name in (FROM_SCRATCH, FINE_TUNED):
        run = RoadDial(
            road, structure, dataclasses.replace(DIAL_NUMBERS, seed=seed), name == FINE_TUNED
        )
        yield job(name, train_dial, run, "demonstrations", cost=40.0)
    driven = Drive(road, config.first_seed, config.episodes)
    yield job("driven", drive, driven, "experts", "trio", FROM_SCRATCH, FINE_TUNED, cost=10.0)


def _experts(config: Config, road: str, seed: int) -> Experts:
    structure = dqn.StaticConfig(
        "set", (128, 128), loss="squared", batch_size=128, steps=config.expert_updates * 48
    )
    numbers = tuple(
        finer(dqn.Hyperparameters(angle=angle, learning_rate=1e-3, polyak=0.02, seed=seed))
        for angle in MODES.values()
    )
    return Experts(road, structure, numbers)
