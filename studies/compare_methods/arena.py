"""Common inputs of all methods of a comparison: data, world, budget and settings."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import numpy as np

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.learners.callbacks import Callbacks, Report
from socialiq.learners.collect import Act, Collector, Source, soft
from socialiq.learners.iq_learn import config as iq
from socialiq.types import Row
from socialiq_lab.comparison import nearest_mode, of_modes
from studies.compare_methods.methods import Method, Setting

CHUNK = 200
"""Updates between two reports, two rounds of acting outside JAX, and two E steps."""


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
        advantage: How V of advantages is found.
    """

    structure: iq.StaticConfig
    numbers: iq.Hyperparameters
    updates: int
    datasets: Sequence[Demonstrations]
    world: Any = None
    make_source: Callable[[int], Source] | None = None
    on_report: Callable[[Report], None] | None = None
    rates: list[float] = field(default_factory=list)
    advantage: str = "advantage"

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
        return self.make_source(min(CHUNK, updates) * steps_per_update)

    def collector(self, static: Any, numbers: Sequence[Any]) -> Collector | None:
        """Return what lets runs act by softmax(Q/τ) outside JAX; None if the world is in JAX."""
        if self.world is not None:
            return None
        source = self.source(static.updates, static.env_steps_per_update)
        behaviour = soft([one.temperature for one in numbers])

        def by_values(network: Any, run: int, done: int, rng: Any) -> Act:
            return behaviour(getattr(network, "values", network), run, done, rng)

        return Collector([source] * len(numbers), [one.seed for one in numbers], by_values)

    def settings(self, kind: Any, run: Run, **fixed: Any) -> tuple[Any, Any]:
        """Return the static config and the hyperparameters of a run.

        Args:
            kind: Has the classes `StaticConfig` and `Hyperparameters` of a learner.
            run: The run; its settings come before the world's.
            **fixed: What the method itself differs in.
        """
        given = fixed | dict(run.setting)
        static = shared_values(kind.StaticConfig, self.structure) | {"updates": self.updates}
        numbers = shared_values(kind.Hyperparameters, self.numbers)
        names = _names(kind.StaticConfig)
        static |= {name: value for name, value in given.items() if name in names}
        own = {"angle": run.angle, "seed": run.seed, "dataset": run.dataset}
        numbers |= {name: own[name] for name in own if name in _names(kind.Hyperparameters)}
        numbers |= {name: value for name, value in given.items() if name not in names}
        return kind.StaticConfig(**static), kind.Hyperparameters(**numbers)

    def of_each_mode(self, runs: Sequence[Run]) -> tuple[list[Demonstrations], list[Run]]:
        """Return the data sets of each mode alone, and runs that name the nearest mode's."""
        parts = list(itertools.product(MODES, range(len(self.datasets))))
        datasets = [of_modes(self.datasets[number], (mode,)) for mode, number in parts]
        placed = [
            run._replace(dataset=parts.index((nearest_mode(run.angle), run.dataset)))
            for run in runs
        ]
        return datasets, placed


def _names(kind: type) -> set[str]:
    return {one.name for one in dataclasses.fields(kind)}


def shared_values(kind: type, source: Any) -> dict[str, Any]:
    """Return the values of the fields that both have."""
    return {name: getattr(source, name) for name in _names(kind) & _names(type(source))}


def speed_row(world: str, method: Method, arena: Arena, runs: int) -> Row:
    """Return updates per second of a method, summed over the runs of a program, and on what.

    Args:
        world: Name of the world.
        method: The method.
        arena: Its inputs, after training.
        runs: Number of runs.
    """
    row: Row = {"world": world, "method": method.name, "runs": runs}
    rate = float(f"{np.mean(arena.rates):.2g}")
    device = jax.devices()[0]
    kind = "one core" if device.platform == "cpu" else device.device_kind
    return row | {"updates_per_second": rate, "device": f"{kind}, JAX {jax.__version__}"}
