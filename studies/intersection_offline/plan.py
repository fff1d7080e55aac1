"""Jobs of the study of offline dials, each after its inputs."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.worlds.intersection import atlas
from socialiq_lab.intersection.demonstration_sets import (
    DEMONSTRATIONS,
    atlas_demonstrations,
)
from socialiq_lab.intersection.driving import (
    DialEvaluation,
    Evaluation,
    evaluate,
    evaluate_dial,
)
from socialiq_lab.intersection.episodes import LAST
from socialiq_lab.intersection.offline_training import (
    AtlasMember,
    CloneRuns,
    OfflineDialRuns,
    copy_of_atlas,
    run_file,
    train_clones,
    train_iq_learn,
    train_offline_dials,
)
from socialiq_lab.jobs import Job
from studies.intersection_offline.config import Config, runs_of


def plan(config: Config) -> list[Job]:
    """Return every job, each after its inputs."""
    jobs = [atlas_demonstrations(config.pool_episodes)]
    entries = atlas.manifest()
    for mode in MODES:
        name = f"expert_{mode}"
        member = AtlasMember(name, entries[name]["sha256"])
        jobs.append(Job(f"demonstrators/{mode}", copy_of_atlas, member))
        jobs.append(_evaluation(config, demonstrator_episodes(mode), jobs[-1].name, LAST))
    for seeds in config.groups:
        jobs += _dials(config, seeds)
        for method in config.methods:
            jobs += _method(config, method, seeds)
    return jobs


def _evaluation(config: Config, name: str, trained: str, driver: str) -> Job:
    given = Evaluation(
        driver, ("greedy",), episodes=config.episodes, first_seed=config.first_episode
    )
    return Job(name, evaluate, given, (trained,), cost=2.0)


def _dials(config: Config, seeds: tuple[int, ...]) -> Iterator[Job]:
    """Yield the training of some dials and the driving of each."""
    structure = config.structure
    runs = OfflineDialRuns(
        structure=structure, numbers=config.numbers, seeds=seeds, size=config.size
    )
    name, cost = f"dials/{seeds[0]}", len(seeds) * structure.updates / 80
    yield Job(name, train_offline_dials, runs, (DEMONSTRATIONS,), cost=cost)
    for seed in seeds:
        driving = DialEvaluation(
            config.angles,
            run_file(seed),
            episodes=config.episodes,
            first_seed=config.first_episode,
        )
        cost = 2.0 * len(config.angles)
        yield Job(dial_episodes(seed), evaluate_dial, driving, (name,), cost=cost)


def _method(config: Config, method: str, seeds: tuple[int, ...]) -> Iterator[Job]:
    """Yield the training of some runs of a method, and the evaluation of each."""
    runs = runs_of(config, method, seeds)
    name = f"learners/{_slug(method)}/{seeds[0]}"
    work = train_clones if isinstance(runs, CloneRuns) else train_iq_learn
    cost = len(seeds) * len(runs.angles) * config.updates / 300
    yield Job(name, work, runs, (DEMONSTRATIONS,), cost=cost)
    for seed, angle in itertools.product(seeds, runs.angles):
        place = method_episodes(method, seed, angle)
        yield _evaluation(config, place, name, run_file(seed, angle))


def _slug(method: str) -> str:
    named = method.replace("R(α)", "total").replace("χ²", "chi2")
    return named.replace(",", "").replace(" ", "-")


def demonstrator_episodes(mode: str) -> str:
    """Return the folder of a demonstrator's episodes."""
    return f"evaluation/demonstrators/{mode}"


def dial_episodes(seed: int) -> str:
    """Return the folder of a dial's episodes."""
    return f"evaluation/dials/{seed}"


def method_episodes(method: str, seed: int, angle: float) -> str:
    """Return the folder of the episodes of a method's run."""
    return f"evaluation/learners/{_slug(method)}/{seed}/{angle:g}"
