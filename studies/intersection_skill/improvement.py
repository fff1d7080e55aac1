"""Jobs of the improved clone: the clone, the choice of η by prediction, and policy iteration.

η is chosen from demonstrations alone: each demonstrator is left out in turn, the method is trained
on the others at the angle of the one left out, and that η is taken whose policies take most of the
actions of the ones left out. No score of any policy enters. Actions are counted and
likelihoods are not compared, since greedy demonstrators have no temperature.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from socialiq.evaluation.branching import Branching
from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.learners import clone_dial
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.dial.rows import stratified_angles
from socialiq.learners.kernel import Trained
from socialiq.learners.policy_iteration import config as iteration
from socialiq.learners.policy_iteration import dial
from socialiq.learners.policy_iteration.regularised import Likeness, RegularisedIteration
from socialiq.nn.dial_policy import DialPolicy
from socialiq.storage import read_json, write_json
from socialiq.worlds.intersection.options import Options
from socialiq_lab.intersection.demonstration_sets import DEMONSTRATIONS
from socialiq_lab.intersection.episodes import DIAL
from socialiq_lab.intersection.fitting import CHUNK, fit, sizes_of
from socialiq_lab.jobs import ProgressCallback
from studies.intersection_skill.jobs import demonstrations

LEFT_OUT, CHOICE = "left-out.json", "choice.json"


@dataclass(frozen=True)
class CloneDialRun:
    """One clone of all demonstrators."""

    structure: clone_dial.StaticConfig
    size: int
    """Transitions of each demonstrator."""
    seed: int


def train_clone_dial(
    config: CloneDialRun, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write the clone."""
    drawn = demonstrations(inputs[DEMONSTRATIONS], config.size, config.seed)
    numbers = [clone_dial.Hyperparameters(seed=config.seed)]
    data = list(drawn.values())
    learner = clone_dial.CloneDial.of(config.structure, data)
    fit(partial(learner.train, numbers), folder, on_progress, [DIAL])


@dataclass(frozen=True, kw_only=True)
class IterationRun:
    """Settings of the policy iteration."""

    structure: dial.StaticConfig
    numbers: iteration.Hyperparameters
    environments: int = 256
    options: Options = field(default_factory=Options)


@dataclass(frozen=True, kw_only=True)
class LeftOutRun(IterationRun):
    """Policies from the other demonstrators, for one that is left out."""

    clone: clone_dial.StaticConfig
    mode: str
    """The one left out."""
    prices: tuple[float, ...]
    """Values of η."""
    size: int


def predict_left_out(
    config: LeftOutRun, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write the share of the actions of the one left out that are predicted, for each η."""
    seed, angle = config.numbers.seed, MODES[config.mode]
    drawn = demonstrations(inputs[DEMONSTRATIONS], config.size, seed)
    wanted = drawn.pop(config.mode)
    others = tuple(MODES[mode] for mode in drawn)
    structure = dataclasses.replace(config.clone, demonstrators=others)
    learner = clone_dial.CloneDial.of(structure, list(drawn.values()))
    clone = learner.train([clone_dial.Hyperparameters(seed=seed)]).policy(0)
    only = {"low": angle, "high": angle, "margin": 0.0, "high_share": None}
    at_angle = dataclasses.replace(config, structure=dataclasses.replace(config.structure, **only))
    done = Callbacks(lambda report: on_progress(report.done / report.total))
    trained = improved(at_angle, clone, config.prices, callbacks=done)
    rows = []
    for run, price in enumerate(config.prices):
        taken = trained.policy(run).at(angle).predict(wanted.observation)[0]
        rows.append({"price": price, "agreement": float((taken == wanted.action).mean())})
    write_json(folder / LEFT_OUT, rows)


def improved(
    config: IterationRun,
    clone: DialPolicy,
    prices: Sequence[float],
    callbacks: Callbacks | None = None,
    chunk: int = CHUNK,
) -> Trained:
    """Train a dial from a clone for each η, in one program."""
    structure = config.structure

    def angles(count: int, rng: np.random.Generator) -> np.ndarray:
        return stratified_angles(structure, count, rng)

    states, sizes = chunk * structure.states_per_update, sizes_of(config.options)
    labellers = [
        Branching(
            config.options,
            states,
            config.environments,
            angles=angles,
            worth=Likeness(clone, price),
        )
        for price in prices
    ]
    numbers, kind = [config.numbers] * len(prices), RegularisedIteration
    return dial.train(structure, numbers, labellers, sizes, callbacks, chunk, clone, kind)


@dataclass(frozen=True)
class Choice:
    """The choice of η; the inputs are all predictions."""


def choose(
    _config: Choice, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write the η of the largest mean agreement over the demonstrators left out."""
    tables = [read_json(trained / LEFT_OUT) for trained in inputs.values()]
    prices = [row["price"] for row in tables[0]]
    means = np.mean([[row["agreement"] for row in table] for table in tables], axis=0)
    write_json(folder / CHOICE, {"price": prices[int(means.argmax())]})
    on_progress(1.0)


def improve(
    config: IterationRun, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write the dial that policy iteration makes of the clone, with the chosen η."""
    clone, choice = inputs.values()
    price = read_json(choice / CHOICE)["price"]
    begun = DialPolicy.load(clone / DIAL)
    fit(partial(improved, config, begun, [price]), folder, on_progress, [DIAL])
