"""Training of a comparison's methods: common inputs, learners, and exact rows of gridworlds.

A learner is a function from the common inputs (`Arena`) and the runs to a policy for each run.
"""

import dataclasses
import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import numpy as np

from socialiq import Demonstrations, RewardPair, score, weights
from socialiq.evaluation.road_training import source_of
from socialiq.evaluation.rollout import MODES
from socialiq.learners import dqn
from socialiq.learners.acting import dials, soft
from socialiq.learners.behaviour_cloning import BehaviourCloning
from socialiq.learners.callbacks import Callbacks, Report
from socialiq.learners.collect import Collector, Source, from_env
from socialiq.learners.cql import ConservativeQ
from socialiq.learners.dial import config as dial
from socialiq.learners.dial.train import train as train_dial
from socialiq.learners.iq_learn import config as presets
from socialiq.learners.iq_learn.train import IQLearn
from socialiq.learners.iq_learn.train import train as train_iq
from socialiq.types import Act, Row
from socialiq.worlds.enumerate import Table
from socialiq.worlds.gym import GridWorldEnv
from socialiq.worlds.intersection.options import Options
from socialiq_lab.comparison import Method, Setting, nearest_mode, of_modes


class Run(NamedTuple):
    """A training run: angle in degrees, seed, number of its data set, settings."""

    angle: float
    seed: int
    dataset: int
    setting: Setting


def runs_of(
    settings: Sequence[Setting], angles: Iterable[float], seeds: Sequence[int]
) -> list[Run]:
    """Return a run for each setting, angle and seed.

    Args:
        settings: Settings of the method.
        angles: Angles in degrees.
        seeds: Training seeds; seed i learns from data set i.

    Returns:
        The runs, the seed varying fastest and the setting slowest.
    """
    return [
        Run(angle, seed, dataset, tuple((name, value) for name, value in setting))
        for setting, angle in itertools.product(settings, angles)
        for dataset, seed in enumerate(seeds)
    ]


@dataclass
class Arena:
    """Common inputs of all methods of a world.

    Attributes:
        structure: Network, batches, replay and endings, as IQ-Learn's static config.
        numbers: Rates and discounts, as IQ-Learn's hyperparameters.
        updates: Gradient steps of each network, and steps in the world.
        datasets: A mixture for each seed.
        world: The world, for compiled programs to act in; None where it is not in JAX.
        make_source: Makes experience from outside JAX, given the steps of a chunk.
        on_report: Progress callback.
        rates: Updates per second, summed over the runs of a program; the learners add to it.
        advantage: How V of advantages is computed.
        chunk: Updates between two reports, two rounds of acting outside JAX, and two E steps.
    """

    structure: Any
    numbers: Any
    updates: int
    datasets: Sequence[Demonstrations]
    world: Any = None
    make_source: Callable[[int], Source] | None = None
    on_report: Callable[[Report], None] | None = None
    rates: list[float] = field(default_factory=list)
    advantage: str = "advantage"
    chunk: int = 200

    def callbacks(self) -> Callbacks:
        """Return the callbacks of a program: progress, and its rate at the end."""

        def on_report(report: Report) -> None:
            if report.done == report.total:
                self.rates.append(report.rate)
            if self.on_report:
                self.on_report(report)

        return Callbacks(on_report)

    @property
    def sizes(self) -> tuple[int, int]:
        """Features of an observation, and number of actions."""
        return self.datasets[0].n_features, self.datasets[0].n_actions

    def source(self, updates: int, steps_per_update: int) -> Source:
        """Return experience from outside JAX for one chunk of a run.

        Args:
            updates: Number of updates of the run.
            steps_per_update: Steps in the world for each update.

        Returns:
            A source of the steps of a chunk, or of the whole run if that is shorter.
        """
        assert self.make_source is not None
        return self.make_source(min(self.chunk, updates) * steps_per_update)

    def collector(self, static: Any, numbers: Sequence[Any]) -> Collector | None:
        """Return a collector that lets runs act by softmax(Q/τ) outside JAX.

        Args:
            static: Static configuration of the runs.
            numbers: Hyperparameters of each run, with its temperature τ and its seed.

        Returns:
            The collector; None if the world is in JAX.
        """
        if self.world is not None:
            return None
        source = self.source(static.updates, static.env_steps_per_update)
        behaviour = soft([run.temperature for run in numbers])

        def by_values(network: Any, run: int, done: int, rng: Any) -> Act:
            return behaviour(getattr(network, "values", network), run, done, rng)

        return Collector([source] * len(numbers), [run.seed for run in numbers], by_values)

    def settings(
        self, config: type[Any], hyperparameters: type[Any], run: Run, **fixed: Any
    ) -> tuple[Any, Any]:
        """Return the static config and the hyperparameters of a run, of the given classes.

        The run's settings come before what makes the method (`fixed`), and that before the world's.

        Args:
            config: Class of the static configuration.
            hyperparameters: Class of the hyperparameters.
            run: The run.
            **fixed: Settings that make the method, by the names of their fields.
        """
        chosen = fixed | dict(run.setting)
        structural = _names(config)
        numeric = _names(hyperparameters)
        static = shared_values(config, self.structure) | {"updates": self.updates}
        static |= {name: value for name, value in chosen.items() if name in structural}
        numbers = shared_values(hyperparameters, self.numbers)
        numbers |= {name: value for name, value in run._asdict().items() if name in numeric}
        numbers |= {name: value for name, value in chosen.items() if name not in structural}
        return config(**static), hyperparameters(**numbers)

    def of_each_mode(self, runs: Sequence[Run]) -> tuple["Arena", list[Run]]:
        """Return an arena with data sets of each mode alone, and runs on the nearest mode's."""
        pairs = list(itertools.product(MODES, range(len(self.datasets))))
        datasets = [of_modes(self.datasets[number], (mode,)) for mode, number in pairs]
        of_nearest = [
            run._replace(dataset=pairs.index((nearest_mode(run.angle), run.dataset)))
            for run in runs
        ]
        return dataclasses.replace(self, datasets=datasets), of_nearest

    def speed_row(self, world: str, method: Method, runs: int) -> Row:
        """Return the row of a method in the table of speeds.

        Args:
            world: Name of the world.
            method: The method, which has been trained in this arena.
            runs: Number of runs of a program.

        Returns:
            Updates per second, summed over the runs of a program: the mean over the programs, to
            two digits; and the device.
        """
        rate = float(f"{np.mean(self.rates):.2g}")
        device = jax.devices()[0]
        kind = "one core" if device.platform == "cpu" else device.device_kind
        label = {"world": world, "method": method.name, "runs": runs}
        return label | {"updates_per_second": rate, "device": f"{kind}, JAX {jax.__version__}"}


def grid_arena(
    table: Table,
    datasets: Sequence[Demonstrations],
    config: Any,
    chunk: int,
    on_report: Callable[[Report], None] | None,
) -> Arena:
    """Return the inputs of all methods in a gridworld.

    Args:
        table: The gridworld.
        datasets: A mixture for each seed.
        config: Configuration with `updates`, `learning_rate` and `polyak`.
        chunk: Updates between two reports.
        on_report: Progress callback.
    """
    rates = {"learning_rate": config.learning_rate, "polyak": config.polyak}
    return Arena(
        presets.TABLE_C1,
        dataclasses.replace(presets.TABLE_C1_NUMBERS, **rates),
        config.updates,
        datasets,
        table.world,
        lambda steps: from_env(GridWorldEnv(table.world.name), steps),
        on_report,
        chunk=chunk,
    )


ENVIRONMENTS = 12
"""Intersections side by side in which a learner acts."""


def intersection_arena(
    datasets: Sequence[Demonstrations],
    updates: int,
    on_report: Callable[[Report], None] | None,
    hidden: tuple[int, ...] = (64, 64),
    batch_size: int = 64,
) -> Arena:
    """Return the inputs of all methods at the intersection.

    Args:
        datasets: A mixture for each seed.
        updates: Gradient steps of each network.
        on_report: Progress callback.
        hidden: Hidden layers of each network, over a view of the vehicles as a set.
        batch_size: Rows of a batch.
    """
    static = presets.INTERSECTION_CALIBRATED
    steps = updates * static.env_steps_per_update
    shape = {"view": "set", "hidden": hidden, "batch_size": batch_size}
    return Arena(
        dataclasses.replace(static, **shape, replay_capacity=min(100_000, steps)),
        dataclasses.replace(presets.INTERSECTION_CALIBRATED_NUMBERS, learning_rate=1e-3),
        updates,
        datasets,
        None,
        lambda steps: source_of(Options(), ENVIRONMENTS, -(-steps // Arena.chunk)),
        on_report,
        advantage="advantage_fitted",
    )


def _names(kind: type) -> set[str]:
    return {field.name for field in dataclasses.fields(kind)}


def shared_values(kind: type, source: Any) -> dict[str, Any]:
    """Return the values of the fields that a class and an object have in common.

    Args:
        kind: A dataclass.
        source: Object of another dataclass.

    Returns:
        The object's values by name of the field.
    """
    return {name: getattr(source, name) for name in _names(kind) & _names(type(source))}


Learner = Callable[..., list[Any]]
"""Trains a policy for each run, given an arena, the runs, and settings that make the method by
their names; a policy with `at` has one for each angle."""


def trained(learner: Learner, arena: Arena, method: Method, runs: Sequence[Run]) -> list[Any]:
    """Train a method with its learner.

    Args:
        learner: The method's learner.
        arena: Inputs that all methods share.
        method: The method. If `of_mode`, each run learns from the episodes of the mode nearest its
            angle.
        runs: The runs.

    Returns:
        A policy for each run.
    """
    inputs = arena.of_each_mode(runs) if method.of_mode else (arena, runs)
    return learner(*inputs, **method.fixed)


def turned(policy: Any, angle: float) -> Any:
    """Return a policy at an angle in degrees: a dial is turned, a mapping has one for each."""
    if isinstance(policy, Mapping):
        return policy[angle]
    return policy.at(angle) if hasattr(policy, "at") else policy


def in_programs(
    settings: Sequence[tuple[Any, Any]], train: Callable[[Any, list[Any]], Any]
) -> list[Any]:
    """Train the runs of each static configuration in one program.

    Args:
        settings: Static configuration and hyperparameters of each run.
        train: Trains the runs of one static configuration, given their hyperparameters.

    Returns:
        The policies in the order of the settings.
    """
    policies: dict[int, Any] = {}
    for static in dict.fromkeys(static for static, _ in settings):
        same = [run for run, (of_run, _) in enumerate(settings) if of_run == static]
        numbers = {run: settings[run][1] for run in same}
        program = train(static, list(numbers.values()))
        policies |= {run: program.policy(number) for number, run in enumerate(numbers)}
    return [policies[run] for run in range(len(settings))]


def offline(learner: Any) -> Learner:
    """Return a function that trains a class of learners from demonstrations alone.

    Args:
        learner: The class. Among the settings that make the method the value "advantage" stands for
            the arena's kind of advantage.
    """

    def train(arena: Arena, runs: Sequence[Run], **fixed: Any) -> list[Any]:
        kinds = learner.StaticConfig, learner.Hyperparameters
        changes = {
            name: arena.advantage if value == "advantage" else value
            for name, value in fixed.items()
        }
        return in_programs(
            [arena.settings(*kinds, run, **changes) for run in runs],
            lambda static, numbers: learner.train_on(
                static, numbers, arena.datasets, arena.callbacks(), arena.chunk
            ),
        )

    return train


BEST = 3  # one episode in so many is cloned by `best_episodes_cloned`, those with the greatest R(α)


def best_episodes(data: Demonstrations, angle: float) -> Demonstrations:
    """Return the episodes with the greatest R(α), one in three.

    Args:
        data: Demonstrations.
        angle: α in degrees.

    Returns:
        The episodes in their order. Equal ones at the limit are all kept, so they may be more.
    """
    returns = RewardPair(*(r[data.episode_starts] for r in data.returns("trajectory", 1.0)))
    scores = score(weights(angle), returns)
    above = len(scores) - np.searchsorted(np.sort(scores), scores, side="right")
    return data.select(np.flatnonzero(BEST * above < len(scores)))


def best_episodes_cloned(arena: Arena, runs: Sequence[Run]) -> list[Any]:
    """Clone the best episodes of each run's data set at its angle.

    Args:
        arena: Inputs that all methods share.
        runs: The runs.

    Returns:
        A policy for each run.
    """
    pairs = list(dict.fromkeys((run.angle, run.dataset) for run in runs))
    datasets = [best_episodes(arena.datasets[number], angle) for angle, number in pairs]
    of_best = [run._replace(dataset=pairs.index((run.angle, run.dataset))) for run in runs]
    return offline(BehaviourCloning)(dataclasses.replace(arena, datasets=datasets), of_best)


def iq_learn(learner: Any = None, acts: bool = True) -> Learner:
    """Return a function that trains IQ-Learn, or a class of learners derived from it.

    Args:
        learner: The derived class; None for IQ-Learn.
        acts: Whether it acts in the world.

    Returns:
        A learner of comparisons.
    """

    def train(arena: Arena, runs: Sequence[Run], **fixed: Any) -> list[Any]:
        world = arena.world if acts else None

        def program(static: Any, numbers: list[Any]) -> Any:
            collector = arena.collector(static, numbers) if acts else None
            options = arena.callbacks(), arena.chunk, collector
            if learner is None:
                return train_iq(static, numbers, arena.datasets, world, *options)
            derived = dataclasses.replace(learner.of(static, arena.datasets), simulator=world)
            return derived.train(numbers, *options)

        kind = learner or IQLearn
        kinds = kind.StaticConfig, kind.Hyperparameters
        return in_programs([arena.settings(*kinds, run, **fixed) for run in runs], program)

    return train


def dial_settings(
    arena: Arena,
    structure: dial.DialConfig,
    numbers: dial.DialHyperparameters,
    run: Run,
    shared: Sequence[str],
) -> tuple[dial.DialConfig, dial.DialHyperparameters]:
    """Return the settings of a dial, with the comparison's network, batches and budget.

    Args:
        arena: Inputs that all methods share.
        structure: Static configuration of the dial.
        numbers: Hyperparameters of the dial.
        run: The run; its settings replace all other hyperparameters of their names.
        shared: Names of the hyperparameters that are taken from the comparison.

    Returns:
        Static configuration and hyperparameters of the run.
    """
    base = arena.structure
    names = "hidden", "activation", "view", "endings", "replay_capacity"
    static = dataclasses.replace(
        structure,
        **{name: getattr(base, name) for name in names},
        expert_batch=base.batch_size,
        replay_batch=base.batch_size,
        environments=base.env_steps_per_update,
        updates=arena.updates,
    )
    changes = {name: getattr(arena.numbers, name) for name in shared} | dict(run.setting)
    return static, dataclasses.replace(numbers, **changes, seed=run.seed, dataset=run.dataset)


def dialled(structure: dial.DialConfig, numbers: dial.DialHyperparameters, *shared: str) -> Learner:
    """Return a function that trains dials: one network for all angles of a run.

    Args:
        structure: Static configuration of the dial.
        numbers: Hyperparameters of the dial.
        *shared: Names of the hyperparameters that are taken from the comparison (`dial_settings`).

    Returns:
        A learner of comparisons.
    """

    def train(arena: Arena, runs: Sequence[Run]) -> list[Any]:
        def program(static: Any, runs_numbers: list[Any]) -> Any:
            collector = None
            if static.online and arena.world is None:
                source = arena.source(static.updates, static.environments)
                collector = Collector(
                    [source] * len(runs_numbers),
                    [run.seed for run in runs_numbers],
                    dials(static, runs_numbers),
                    static.driven_share > 0,
                )
            world = arena.world if static.online else None
            options = {"callbacks": arena.callbacks(), "chunk": arena.chunk}
            options["before_chunk"] = collector
            return train_dial(static, runs_numbers, arena.datasets, world, **options)

        settings = [dial_settings(arena, structure, numbers, run, shared) for run in runs]
        return in_programs(settings, program)

    return train


def reinforcement(arena: Arena, runs: Sequence[Run]) -> list[Any]:
    """Train deep Q-learning, without demonstrations.

    Args:
        arena: Inputs that all methods share; it must have `make_source`.
        runs: The runs.

    Returns:
        A policy for each run.
    """
    per_update = arena.structure.env_steps_per_update
    source = arena.source(arena.updates, per_update)

    def settings(run: Run) -> tuple[Any, Any]:
        static = shared_values(dqn.DQNConfig, arena.structure)
        static |= {"steps": arena.updates * per_update, "steps_per_update": per_update}
        numbers = shared_values(dqn.DQNHyperparameters, arena.numbers)
        numbers |= {"angle": run.angle, "seed": run.seed} | dict(run.setting)
        numbers["final_learning_rate"] = numbers["learning_rate"]
        return dqn.DQNConfig(**static), dqn.DQNHyperparameters(**numbers)

    def program(static: Any, numbers: list[Any]) -> Any:
        chunk = min(arena.chunk, arena.updates)
        sources = [source] * len(numbers)
        return dqn.train(static, numbers, sources, arena.sizes, arena.callbacks(), chunk)

    return in_programs([settings(run) for run in runs], program)


LEARNERS: Mapping[str, Learner] = {
    "iq_learn": iq_learn(),
    "clone": offline(BehaviourCloning),
    "clone_of_best": best_episodes_cloned,
    "cql": offline(ConservativeQ),
    "rl": reinforcement,
}
"""Learners of the library by the `learner` of a method in STUDY.toml; studies add their own."""
