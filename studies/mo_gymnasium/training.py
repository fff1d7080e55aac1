"""Our methods, and the job that trains one of them on a task with several seeds and evaluates it.

Dials and IQ-Learn act in a Gymnasium environment: with a network of values where actions are
discrete, else with actor and critics.
"""

import dataclasses
import itertools
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from socialiq import Demonstrations, UserError, rollout_env
from socialiq.demonstrations.mixture import concatenate
from socialiq.learners.acting import Driver, drawing
from socialiq.learners.collect import Collector, from_env
from socialiq.learners.continuous import config
from socialiq.learners.continuous import train as actors
from socialiq.learners.continuous.standardise import EXPLORED, Standardisation, explored
from socialiq.learners.dial import train as dials
from socialiq.learners.dial.config import DialConfig, DialHyperparameters
from socialiq.learners.iq_learn import config as iq
from socialiq.learners.iq_learn import train as iq_learn
from socialiq.provenance import versions
from socialiq.storage import write_atomically
from socialiq.worlds.environment import action_size, sizes
from socialiq_lab.jobs import ProgressCallback
from studies.mo_gymnasium.tasks import ANGLES, FOLDER, TASKS, Piece, Task

DIAL, EXPERTS = "dial", "experts"
STANDARDISED, SHOWN_DIAL, TRIO = "dial, standardised", "dial from demonstrations", "IQ-Learn trio"
METHODS = (DIAL, STANDARDISED, EXPERTS, SHOWN_DIAL, TRIO)
"""Our methods. `experts` are three policies of 0, 45 and 90 degrees, each with a third of the
steps; the last two learn from episodes of such experts, whose steps count too. With continuous
actions, `STANDARDISED` first takes steps at random, by which its networks' inputs are scaled."""

EXPERT_ANGLES = (0.0, 45.0, 90.0)
SHOWN_EPISODES = 2  # episodes that each expert shows
LIBRARIES = ("socialiq", "mo-gymnasium", "gymnasium", "jax", "numpy")
ROUND, ACTOR_ROUND = 100, 50
"""Steps, and as many updates, before a learner of values, or an actor, acts with newer weights."""

NUMBERS = DialHyperparameters(temperature=0.01)
"""Numbers of the dials; chosen on training seeds 100 and 101."""

LAST_EXPLORATION = 0.2
"""Share of random actions in the second half of a training; it falls from 1 in the first half."""

TRIO_NUMBERS = iq.IQLearnHyperparameters(learning_rate=1e-3, temperature=0.1, prior_weight=5.0)
"""Numbers of IQ-Learn; tried on training seed 100, not tuned."""


def value_dials(
    task: Task,
    steps: int,
    seeds: Sequence[int],
    datasets: Sequence[Demonstrations] = (),
    only: float | None = None,
) -> list[Any]:
    """Train a dial for each seed, online, for all angles from 0 to 90 degrees or `only` one."""
    env, demonstrated = task.make(), bool(datasets)
    space: Any = env.observation_space
    static = DialConfig(
        demonstrations=demonstrated,
        backup="double",
        hidden=task.hidden,
        one_hot=one_hot(space.low, space.high) if task.exact else (),
        expert_batch=task.batch_size // 2,
        replay_batch=task.batch_size // 2 if demonstrated else task.batch_size,
        updates=steps,
        replay_capacity=steps,
        environments=1,
        endings=iq.Endings(timeout="bootstrap"),
    )
    if only is not None:
        static = dataclasses.replace(static, low=only, high=only, margin=0.0)
    base = dataclasses.replace(NUMBERS, discount=task.discount)
    numbers = [
        dataclasses.replace(base, seed=seed, dataset=number * demonstrated)
        for number, seed in enumerate(seeds)
    ]

    def exploring(network: Any, run: int, done: int, rng: Any) -> Driver:
        share = max(LAST_EXPLORATION, 1.0 - 2.0 * done / steps)
        explores = dataclasses.replace(numbers[run], exploration=share)
        return Driver(static, explores, network, rng)

    sources = [from_env(task.make(), ROUND, goes_on=True) for _ in seeds]
    collect = Collector(sources, list(seeds), exploring)
    options: dict[str, Any] = {"chunk": ROUND, "before_chunk": collect}
    return _policies(dials.train(static, numbers, list(datasets), None, sizes(env), **options))


def one_hot(low: np.ndarray, high: np.ndarray) -> tuple[tuple[int, int], ...]:
    """Return the smallest value and the number of values of each whole number observed."""
    return tuple((int(least), int(most - least) + 1) for least, most in zip(low, high, strict=True))


def _policies(trained: Any) -> list[Any]:
    return [trained.policy(run) for run in range(len(trained.hyperparameters))]


ACTOR_NUMBERS = config.SACHyperparameters(learning_rate=1e-3, temperature=0.1, polyak=0.005)
"""Numbers of soft actor-critic, and its dial; not tuned."""

DEMONSTRATED = config.ActorIQLearnHyperparameters(
    learning_rate=1e-3, temperature=0.1, polyak=0.005, prior_weight=30.0
)
"""Numbers of IQ-Learn, and its dial; not tuned."""


def actor_dials(
    task: Task, steps: int, seeds: Sequence[int], datasets: Sequence[Demonstrations] = ()
) -> list[Any]:
    """Train a dial for each seed, online; the arguments are those of `value_dials`."""
    if not datasets:
        return soft_actors(task, steps, [(seed, 0.0) for seed in seeds], dial=True)
    base = dataclasses.replace(DEMONSTRATED, discount=task.discount)
    numbers = [dataclasses.replace(base, seed=s, dataset=i) for i, s in enumerate(seeds)]
    return _collected(task, _demonstrated(task, steps, dial=True), numbers, datasets)


def soft_actors(
    task: Task,
    steps: int,
    runs: Sequence[tuple[int, float]],
    dial: bool = False,
    changes: Sequence[Standardisation] = (),
) -> list[Any]:
    """Train soft actor-critic, or its dial, for each run: a seed, and an angle in degrees."""
    static = config.SACConfig(**_shared(task, steps), batch_size=task.batch_size, dial=dial)
    base = dataclasses.replace(ACTOR_NUMBERS, discount=task.discount)
    numbers = [dataclasses.replace(base, seed=seed, angle=angle) for seed, angle in runs]
    return _collected(task, static, numbers, changes=changes)


def _shared(task: Task, updates: int) -> dict[str, Any]:
    shared = {"hidden": task.hidden, "updates_per_round": ACTOR_ROUND}
    return shared | {"updates": updates, "replay_capacity": updates}


def _demonstrated(task: Task, updates: int, **changes: Any) -> config.ActorIQLearnConfig:
    options: dict[str, Any] = {"prior": "shifted_chi2", "chi2_on": "mixture"} | changes
    batch_size = task.batch_size // 2
    return config.ActorIQLearnConfig(**_shared(task, updates), batch_size=batch_size, **options)


def _collected(
    task: Task,
    static: Any,
    numbers: Sequence[Any],
    datasets: Sequence[Demonstrations] = (),
    changes: Sequence[Standardisation] = (),
) -> list[Any]:
    """Train with experience of the task, which goes on from round to round."""
    makers = [change.maker(task.make) for change in changes] or [task.make] * len(numbers)
    sources = [from_env(make(), ACTOR_ROUND, continuous=True, goes_on=True) for make in makers]
    acts = drawing(static, static.env_steps_per_update)
    collect = Collector(sources, [run.seed for run in numbers], acts)
    env = task.make()
    shape = sizes(env)[0], action_size(env)
    options: dict[str, Any] = {"chunk": ACTOR_ROUND, "before_chunk": collect}
    return _policies(actors.train(static, numbers, datasets, None, shape, **options))


@dataclasses.dataclass(frozen=True)
class Training:
    """Training of one method on a task with several seeds, in one program."""

    task: str
    method: str
    seeds: tuple[int, ...]
    steps: int


def train_and_evaluate(
    run: Training, folder: Path, _inputs: Mapping[str, Path], progress: ProgressCallback
) -> None:
    """Write one piece for each seed."""
    task = dataclasses.replace(TASKS[run.task], steps=run.steps)
    began = time.perf_counter()
    outcomes, steps, settings = trained(task, run.method, run.seeds)
    seconds = (time.perf_counter() - began) / len(outcomes)
    progress(0.8)
    (folder / FOLDER).mkdir(exist_ok=True)
    for seed, outcome in zip(run.seeds, outcomes, strict=True):
        turned = not isinstance(outcome, list)
        policies = [outcome.at(angle) for angle in ANGLES] if turned else outcome
        totals = []
        for policy in policies:
            rolled = rollout_env(task.make(), policy, task.episodes, task.first_episode)
            sums = rolled.transitions.totals()
            totals.append([round(float(total.mean()), 6) for total in sums])
        piece = Piece(
            task=run.task,
            method=run.method,
            seed=seed,
            steps=steps,
            evaluation_steps_while_training=0,
            angles=list(ANGLES) if turned else None,
            totals=totals,
            settings=settings | {"allowed_steps": run.steps},
            seconds=round(seconds, 1),
            versions=versions(LIBRARIES),
        )
        write_atomically(folder / FOLDER / piece.file, piece.content())


def trained(task: Task, method: str, seeds: Sequence[int]) -> tuple[list[Any], int, dict[str, Any]]:
    """Return for each seed a dial or a list of policies, the steps taken, and the settings."""
    train_dials = actor_dials if task.continuous else value_dials
    size, count = ACTOR_ROUND if task.continuous else ROUND, len(EXPERT_ANGLES)
    names = ("learning_rate", "temperature", "polyak", "strength")
    numbers = dataclasses.asdict(ACTOR_NUMBERS if task.continuous else NUMBERS)
    settings = {name: value for name, value in numbers.items() if name in names}
    settings |= {"hidden": list(task.hidden), "batch_size": task.batch_size}
    settings["discount"] = task.discount
    if method == DIAL:
        steps = task.steps // size * size  # whole rounds
        return train_dials(task, steps, seeds), steps, settings
    if method == STANDARDISED:
        steps = (task.steps - EXPLORED) // size * size
        if steps <= 0:
            raise UserError(f"{task.steps} steps are too few: {EXPLORED} are taken at random")
        changes = [Standardisation.of(explored(task.make(), seed)) for seed in seeds]
        policies = soft_actors(task, steps, [(seed, 0.0) for seed in seeds], True, changes)
        dials_of = [change.policy(dial) for change, dial in zip(changes, policies, strict=True)]
        return dials_of, EXPLORED + steps, settings
    if method == EXPERTS:
        steps = task.steps // count // size * size
        return experts(task, steps, seeds), count * steps, settings
    # Experts show episodes. Of a trio they have all steps; a dial takes half of them itself.
    reserved = count * SHOWN_EPISODES * task.time_limit()
    share = count if method == TRIO else 2 * count
    steps = (task.steps - reserved) // share // size * size
    if steps <= 0:
        raise UserError(
            f"{task.steps} steps are too few for {method}: episodes of its experts take {reserved}"
        )
    trios = zip(experts(task, steps, seeds), seeds, strict=True)
    datasets = [demonstrations(task, *trio_and_seed) for trio_and_seed in trios]
    taken = count * steps + max(dataset.n_transitions for dataset in datasets)
    settings |= {"steps_of_an_expert": steps, "episodes_shown": SHOWN_EPISODES}
    if method == TRIO:
        return train_trio(task, datasets, seeds), taken, settings
    own_steps = (task.steps - taken) // size * size
    policies = train_dials(task, own_steps, seeds, datasets)
    return policies, taken + own_steps, settings | {"own_steps": own_steps}


def experts(task: Task, steps: int, seeds: Sequence[int]) -> list[list[Any]]:
    """Return for each seed a policy of each angle, trained on R(α) alone."""
    if task.continuous:
        return _by_seed(soft_actors(task, steps, [(s, a) for s in seeds for a in EXPERT_ANGLES]))
    by_angle = [
        [dial.at(angle) for dial in value_dials(task, steps, seeds, only=angle)]
        for angle in EXPERT_ANGLES
    ]
    return [list(policies) for policies in zip(*by_angle, strict=True)]


def _by_seed(policies: Sequence[Any]) -> list[list[Any]]:
    size = len(EXPERT_ANGLES)
    return [list(policies[first : first + size]) for first in range(0, len(policies), size)]


def train_trio(
    task: Task, datasets: Sequence[Demonstrations], seeds: Sequence[int]
) -> list[list[Any]]:
    """Return for each seed a policy of each expert's angle: IQ-Learn offline on its data set."""
    base = DEMONSTRATED if task.continuous else TRIO_NUMBERS
    runs = itertools.product(enumerate(seeds), EXPERT_ANGLES)
    numbers = [
        dataclasses.replace(base, discount=task.discount, seed=seed, angle=angle, dataset=number)
        for (number, seed), angle in runs
    ]
    if task.continuous:
        offline = {"online": False, "value_term": "value_expert", "chi2_on": "expert"}
        actor = _demonstrated(task, 3000, **offline)
        return _by_seed(_policies(actors.train(actor, numbers, datasets)))
    static = iq.IQLearnConfig(
        prior="shifted_chi2",
        target_kind="instantaneous",
        value_term="value_expert",
        online=False,
        hidden=task.hidden,
        batch_size=task.batch_size,
        updates=5000,
        endings=iq.Endings(timeout="bootstrap"),
    )
    return _by_seed(_policies(iq_learn.train(static, numbers, list(datasets))))


def demonstrations(task: Task, policies: Sequence[Any], seed: int) -> Demonstrations:
    """Return the episodes that experts show, driven with their random actions."""
    episodes = []
    for angle, policy in zip(EXPERT_ANGLES, policies, strict=True):
        first = 1_000_000 + 1000 * seed + int(angle)
        mode = f"{angle:g} degrees"
        driven = rollout_env(task.make(), policy, SHOWN_EPISODES, first, False, mode)
        episodes.append(driven.transitions)
    return concatenate(episodes)
