"""Do demonstrations add anything beyond RL on R(α)? With networks, in the intersection, resumable.

All demonstrators also drive smoothly and keep the junction clear (`skill.skill`), which neither
r_env nor r_social speaks of. Every method is told R(α); all but the first see the demonstrations of
0, 45 and 90 degrees. They are scored on R(α) + c h, also at angles that nobody demonstrated.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.experiments.intersection.demonstration_sets import DEMONSTRATIONS
from socialiq.experiments.jobs import Job
from socialiq.studies.intersection_skill.config import (
    ALONE,
    CLONES,
    EXPERTS,
    FOLDERS,
    INFERRED,
    RETURNS,
    UNSKILLED,
    Config,
)
from socialiq.studies.intersection_skill.demonstrations import Recording, record_demonstrators
from socialiq.studies.intersection_skill.driving import Driving, evaluate, unskilled_name
from socialiq.studies.intersection_skill.inference import Inference, infer
from socialiq.studies.intersection_skill.jobs import (
    CloneRun,
    DialRun,
    ExpertRun,
    ReturnsRun,
    train_clones,
    train_expert,
    train_family,
    train_returns,
)
from socialiq.worlds.intersection import atlas


def plan(config: Config) -> list[Job]:
    """Every job, each after its inputs."""
    experts = [_expert(config, angle) for angle in MODES.values()]
    taught = tuple(job.name for job in experts)
    jobs = [
        *experts,
        Job(DEMONSTRATIONS, record_demonstrators, Recording(config.pool_episodes), taught, 20.0),
    ]
    entries = atlas.manifest()
    sha256 = tuple(entries[unskilled_name(mode)]["sha256"] for mode in MODES)
    jobs += [_driving(config, FOLDERS[EXPERTS], taught)]
    jobs += [_driving(config, FOLDERS[UNSKILLED], (), sha256)]
    for seed in config.seeds:
        jobs += _learners(config, seed)
    return jobs


def _expert(config: Config, angle: float) -> Job:
    numbers = dataclasses.replace(config.expert_numbers, angle=angle)
    run = ExpertRun(config.expert_structure, numbers, config.weight)
    cost = config.expert_structure.updates / 150
    return Job(f"{FOLDERS[EXPERTS]}/{angle:g}", train_expert, run, cost=cost)


def _driving(
    config: Config, name: str, inputs: tuple[str, ...], sha256: tuple[str, ...] = ()
) -> Job:
    driving = Driving(config.angles, config.episodes, sha256=sha256)
    return Job(f"evaluation/{name}", evaluate, driving, inputs, cost=2.0 * len(config.angles))


def _learners(config: Config, seed: int) -> Iterator[Job]:
    """Every learner of a seed: training, then driving."""
    makers = {RETURNS: _returns, CLONES: _clones}
    for method in (*config.methods, CLONES):
        name = f"{FOLDERS[method]}/{seed}"
        if method in makers:
            yield makers[method](config, name, seed)
        else:
            yield from _dial(config, method, seed)
        yield _driving(config, name, (name,))


def _dial(config: Config, method: str, seed: int) -> Iterator[Job]:
    """A dial; where angles are inferred, an E-step before it and one after it."""
    structure, numbers = config.dial_of(method), config.numbers_of(method, seed)
    learning = DialRun(structure, numbers, config.size, config.weight, config.steps_per_update)
    name, inputs = (
        f"{FOLDERS[method]}/{seed}",
        (DEMONSTRATIONS,) if structure.demonstrations else (),
    )
    step = Inference(config.size, seed, config.grid)
    if method == INFERRED:
        before = f"angles/0/{seed}"
        yield Job(before, infer, step, (f"{FOLDERS[ALONE]}/{seed}", DEMONSTRATIONS))
        inputs = (DEMONSTRATIONS, before)
    yield Job(name, train_family, learning, inputs, cost=structure.updates / 80)
    if method == INFERRED:
        yield Job(f"angles/1/{seed}", infer, step, (name, DEMONSTRATIONS))


def _returns(config: Config, name: str, seed: int) -> Job:
    numbers = tuple(
        dataclasses.replace(config.returns_numbers, angle=angle, seed=seed)
        for angle in config.angles
    )
    run = ReturnsRun(config.returns_structure, numbers, config.size)
    cost = len(numbers) * config.returns_structure.updates / 100
    return Job(name, train_returns, run, (DEMONSTRATIONS,), cost=cost)


def _clones(config: Config, name: str, seed: int) -> Job:
    run = CloneRun(config.clone_structure, config.size, seed)
    return Job(name, train_clones, run, (DEMONSTRATIONS,), cost=config.clone_structure.updates / 50)
