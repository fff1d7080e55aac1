"""Methods with grids of settings, all trained at one budget and evaluated exactly in gridworlds.

A comparison is a table of `Method`, and a learner for each: a function from the common inputs
(`Arena`) and the runs to a policy for each run.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.evaluation.exact import READOUTS, Ground, Readout, action_table, evaluate_exactly
from socialiq.evaluation.rollout import MODES, trajectory_datasets
from socialiq.learners import dqn
from socialiq.learners.acting import soft
from socialiq.learners.callbacks import Callbacks, Report
from socialiq.learners.collect import Collector, Source, from_env
from socialiq.learners.dqn import train as train_dqn
from socialiq.learners.iq_learn import config as iq
from socialiq.learners.iq_learn.train import train as train_iq
from socialiq.types import Act, Row
from socialiq.worlds.gym import GridWorldEnv
from socialiq_lab.comparison import nearest_mode, of_modes

Setting = tuple[tuple[str, float], ...]
"""Settings by name that differ from the world's."""


def product(**values: Sequence[float]) -> tuple[Setting, ...]:
    """Return the grid of all combinations of values."""
    return tuple(
        tuple(zip(values, combination, strict=True))
        for combination in itertools.product(*values.values())
    )


def setting_name(setting: Setting) -> str:
    """Return a setting in one cell of a table."""
    return ", ".join(f"{name} {value:g}" for name, value in setting)


@dataclass(frozen=True)
class Method:
    """A row of a comparison.

    Attributes:
        name: Name of the row and of its folders.
        label: Name in tables and figures.
        learner: Name of its learner.
        settings: Grid from which one is chosen on the development seeds.
        told: Inputs beside observations and actions.
        serves: What one network serves: an "angle", a "mode" (the nearest demonstrator's, whose
            episodes it learns from), or "all" angles.
        gridworlds: Whether it runs in the gridworlds.
        intersection: Whether it runs in the intersection.
        soft: Whether its stochastic policy means something.
    """

    name: str
    label: str
    learner: str
    settings: tuple[Setting, ...]
    told: tuple[str, ...] = ()
    serves: str = "angle"
    gridworlds: bool = True
    intersection: bool = True
    soft: bool = True

    @property
    def readouts(self) -> tuple[Readout, ...]:
        """Evaluated action selections."""
        return READOUTS if self.soft else READOUTS[:1]

    def setting_of(self, name: str) -> Setting:
        """Return the setting of that name in the grid."""
        return next(setting for setting in self.settings if setting_name(setting) == name)

    def served(self, angles: tuple[float, ...]) -> dict[float, tuple[float, ...]]:
        """Return the angle that each network is trained for, and the angles that it serves."""
        if self.serves == "all":
            return {0.0: angles}
        if self.serves == "angle":
            return {angle: (angle,) for angle in angles}
        served = {
            mode_angle: tuple(angle for angle in angles if nearest_mode(angle) == mode)
            for mode, mode_angle in MODES.items()
        }
        return {groups: group for groups, group in served.items() if group}


class Run(NamedTuple):
    """A training run: angle in degrees, seed, number of its data set, settings."""

    angle: float
    seed: int
    dataset: int
    setting: Setting


def runs_of(
    settings: Sequence[Setting], angles: Iterable[float], seeds: Sequence[int]
) -> list[Run]:
    """Return a run for each setting, angle in degrees and seed; each seed has its own data set."""
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
        make_source: Makes experience from outside JAX, of so many steps for each chunk.
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
        """Return experience from outside JAX for a chunk of a run of so many updates."""
        assert self.make_source is not None
        return self.make_source(min(self.chunk, updates) * steps_per_update)

    def collector(self, static: Any, numbers: Sequence[Any]) -> Collector | None:
        """Return what lets runs act by softmax(Q/τ) outside JAX; None if the world is in JAX."""
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
        """Return the static config and the hyperparameters of a run.

        Args:
            config: Class of a learner's static config.
            hyperparameters: Class of its hyperparameters.
            run: The run; its settings come before the world's.
            **fixed: What the method itself differs in.
        """
        chosen = fixed | dict(run.setting)
        of_run = {"angle": run.angle, "seed": run.seed, "dataset": run.dataset}
        structural = _names(config)
        static = shared_values(config, self.structure) | {"updates": self.updates}
        static |= {name: value for name, value in chosen.items() if name in structural}
        numbers = shared_values(hyperparameters, self.numbers)
        numbers |= {name: of_run[name] for name in of_run if name in _names(hyperparameters)}
        numbers |= {name: value for name, value in chosen.items() if name not in structural}
        return config(**static), hyperparameters(**numbers)

    def of_each_mode(self, runs: Sequence[Run]) -> tuple[list[Demonstrations], list[Run]]:
        """Return the data sets of each mode alone, and runs that name the nearest mode's."""
        pairs = list(itertools.product(MODES, range(len(self.datasets))))
        datasets = [of_modes(self.datasets[number], (mode,)) for mode, number in pairs]
        placed = [
            run._replace(dataset=pairs.index((nearest_mode(run.angle), run.dataset)))
            for run in runs
        ]
        return datasets, placed

    def speed_row(self, world: str, method: Method, runs: int) -> Row:
        """Return updates per second of a method, summed over the runs of a program, and on what."""
        rate = float(f"{np.mean(self.rates):.2g}")
        device = jax.devices()[0]
        kind = "one core" if device.platform == "cpu" else device.device_kind
        label = {"world": world, "method": method.name, "runs": runs}
        return label | {"updates_per_second": rate, "device": f"{kind}, JAX {jax.__version__}"}


def _names(kind: type) -> set[str]:
    return {field.name for field in dataclasses.fields(kind)}


def shared_values(kind: type, source: Any) -> dict[str, Any]:
    """Return the values of the fields that both have."""
    return {name: getattr(source, name) for name in _names(kind) & _names(type(source))}


# ----------------------------------------------------------------------------------------------
# Learners
# ----------------------------------------------------------------------------------------------

Learner = Callable[[Arena, Method, Sequence[Run]], list[Any]]
"""Trains a policy for each run; one with `at` has a policy for each angle."""


def in_programs(
    settings: Sequence[tuple[Any, Any]], train: Callable[[Any, list[Any]], Any]
) -> list[Any]:
    """Train the runs of each static config in one program; return policies in the runs' order."""
    policies: dict[int, Any] = {}
    for static in dict.fromkeys(static for static, _ in settings):
        places = [index for index, (own_static, _) in enumerate(settings) if own_static == static]
        trained = train(static, [settings[place_value][1] for place_value in places])
        policies |= {run: trained.policy(number) for number, run in enumerate(places)}
    return [policies[index] for index in range(len(settings))]


def offline(learner: Any, of_mode: bool = False, **fixed: Any) -> Learner:
    """Return the training of a learner of demonstrations alone.

    Args:
        learner: Its class.
        of_mode: Whether it learns from the nearest mode alone, also where it serves one angle.
        **fixed: Settings that make the method.
    """

    def train(arena: Arena, method: Method, runs: Sequence[Run]) -> list[Any]:
        datasets = list(arena.datasets)
        if of_mode or method.serves == "mode":
            datasets, runs = arena.of_each_mode(runs)
        changes = {
            name: arena.advantage if name in ("advantage", "weighted_by") else value
            for name, value in fixed.items()
        }
        kinds = learner.StaticConfig, learner.Hyperparameters
        return in_programs(
            [arena.settings(*kinds, run, **changes) for run in runs],
            lambda static, numbers: learner.train_on(
                static, numbers, datasets, arena.callbacks(), arena.chunk
            ),
        )

    return train


def iq_learn(learner: Any = None, acts: bool = True, **fixed: Any) -> Learner:
    """Return the training of IQ-Learn, or of a learner derived from it.

    Args:
        learner: Class of the derived learner; None for IQ-Learn itself.
        acts: Whether it acts in the world.
        **fixed: Settings that make the method.
    """

    def train(arena: Arena, method: Method, runs: Sequence[Run]) -> list[Any]:
        datasets = list(arena.datasets)
        if method.serves == "mode":
            datasets, runs = arena.of_each_mode(runs)
        world = arena.world if acts else None

        def program(static: Any, numbers: list[Any]) -> Any:
            collector = arena.collector(static, numbers) if acts else None
            options = arena.callbacks(), arena.chunk, collector
            if learner is None:
                return train_iq(static, numbers, datasets, world, *options)
            return learner.of(static, datasets, world).train(numbers, *options)

        kinds = iq.IQLearnConfig, iq.IQLearnHyperparameters
        if learner is not None:
            kinds = learner.StaticConfig, learner.Hyperparameters
        return in_programs([arena.settings(*kinds, run, **fixed) for run in runs], program)

    return train


def reinforcement(arena: Arena, _method: Method, runs: Sequence[Run]) -> list[Any]:
    """Train deep Q-learning, without demonstrations."""
    per_update = arena.structure.env_steps_per_update
    source = arena.source(arena.updates, per_update)

    def settings(run: Run) -> tuple[Any, Any]:
        static = shared_values(dqn.DQNConfig, arena.structure)
        static |= {"steps": arena.updates * per_update, "steps_per_update": per_update}
        numbers = shared_values(dqn.DQNHyperparameters, arena.numbers)
        numbers |= {"angle": run.angle, "seed": run.seed} | dict(run.setting)
        numbers["final_learning_rate"] = numbers["learning_rate"]
        return dqn.DQNConfig(**static), dqn.DQNHyperparameters(**numbers)

    return in_programs(
        [settings(run) for run in runs],
        lambda static, numbers: train_dqn(
            static,
            numbers,
            [source] * len(numbers),
            arena.sizes,
            arena.callbacks(),
            min(arena.chunk, arena.updates),
        ),
    )


# ----------------------------------------------------------------------------------------------
# In a gridworld
# ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class GridRuns:
    """Configuration of a job: runs of a method in a gridworld."""

    world: str
    method: str
    structure: iq.IQLearnConfig
    numbers: iq.IQLearnHyperparameters
    updates: int
    """Of each network."""
    angles: tuple[float, ...]
    settings: tuple[Setting, ...]
    seeds: tuple[int, ...]
    episodes_each: int
    chunk: int = 200

    def arena(self, ground: Ground, on_progress: Callable[[float], None]) -> Arena:
        """Return the inputs of a method, with an equal mixture of trajectories for each seed."""
        return Arena(
            self.structure,
            self.numbers,
            self.updates,
            trajectory_datasets(ground.table, self.seeds, self.episodes_each),
            ground.table.world,
            lambda steps: from_env(GridWorldEnv(self.world), steps),
            lambda report: on_progress(0.9 * report.done / report.total),
            chunk=self.chunk,
        )


def chances(
    ground: Ground, policy: Any, angle: float, readout: Readout
) -> Float[np.ndarray, "state action"]:
    """Return action probabilities of a policy at an angle.

    Args:
        ground: The world.
        policy: A policy, one with `at`, or a table of probabilities by angle.
        angle: In degrees.
        readout: Action selection.
    """
    if isinstance(policy, Mapping):
        table = policy[angle]
        greedy = np.eye(table.shape[1])[table.argmax(axis=1)]
        return greedy if readout == "greedy" else table
    turned = policy.at(angle) if hasattr(policy, "at") else policy
    return action_table(turned, ground.part, readout)


def rows_of(
    ground: Ground, method: Method, label: Row, seed: int, policy: Any, angles: Sequence[float]
) -> list[Row]:
    """Return a policy's exact metrics and its regret at each angle that it serves.

    Args:
        ground: The world.
        method: The method.
        label: Columns of every row: world, method, setting.
        seed: Training seed.
        policy: As of `chances`.
        angles: In degrees.
    """
    rows: list[Row] = []
    for angle, readout in itertools.product(angles, method.readouts):
        metrics = evaluate_exactly(ground.part, chances(ground, policy, angle, readout))
        labels = {"target_angle": angle, "readout": readout, "seed": seed}
        regret = ground.optimum.regret(metrics, angle)
        values = {"value": metrics.value(angle), "regret": regret}
        rows.append(label | labels | metrics._asdict() | values)
    return rows
