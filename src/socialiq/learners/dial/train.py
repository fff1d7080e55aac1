"""Training of the dial: one network for a range of angles, many runs in one compiled program."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax.tree_util import Partial
from jaxtyping import Array

from socialiq.learners import loop, replay
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.dial.acting import Acting, act, begin
from socialiq.learners.dial.config import Hyperparameters, StaticConfig, check_fit
from socialiq.learners.dial.objective import Networks, Traced, objective
from socialiq.learners.dial.rows import draw_rows
from socialiq.learners.expert_table import ExpertTable
from socialiq.learners.state import History, Runs
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_network import QNetwork, network_of
from socialiq.types import Simulator, Transitions

BeforeChunk = Callable[[Runs, int], Runs]
"""Called with the runs and the number of updates done, before each chunk."""

_ADAM = optax.scale_by_adam()  # the traced learning rate is applied by hand


class Learnt(NamedTuple):
    """What training changes; `slow` is what a policy is made of."""

    network: DialNetwork
    target_network: DialNetwork
    skill: QNetwork | None
    adam: Any


class Surroundings(NamedTuple):
    """What an update carries along.

    Attributes:
        key: Random key.
        replay: The learner's own transitions; None offline.
        acting: Where it acts; None offline, or if experience comes from outside JAX.
        multiplier: What a budget has made of the prior's weight (`learners.dial.budget`).
    """

    key: Array
    replay: replay.Replay | None
    acting: Acting | None
    multiplier: Array


@dataclass(frozen=True)
class Trained:
    """The outcome of a training call.

    Attributes:
        static: Of all runs.
        hyperparameters: Of each run.
        networks: The target networks, arrays with a leading run axis.
        skills: What the demonstrators share, f; None if no demonstrators are told.
        multipliers: Of each run at the end, 1 without a budget.
        history: What was recorded, (chunks, runs).
        failures: One line for each run that stopped early.
    """

    static: StaticConfig
    hyperparameters: tuple[Hyperparameters, ...]
    networks: DialNetwork
    skills: QNetwork | None
    multipliers: tuple[float, ...]
    history: History
    failures: tuple[str, ...]

    def dial(self, run: int) -> DialPolicy:
        """The trained dial of one run."""
        network = network_of(self.networks, run)
        return dial_of(self.static, self.hyperparameters[run], network, self.multipliers[run])


def dial_of(
    static: StaticConfig,
    hyperparameters: Hyperparameters,
    network: DialNetwork,
    multiplier: float = 1.0,
) -> DialPolicy:
    """A network as a dial with its record."""
    record = {
        "learner": "dial",
        "structure": dataclasses.asdict(static),
        "numbers": dataclasses.asdict(hyperparameters),
        "multiplier": multiplier,
    }
    temperature = hyperparameters.temperature / multiplier
    return DialPolicy.of(network, temperature, static.low, static.high, record)


def train(
    static: StaticConfig,
    hyperparameters: Sequence[Hyperparameters],
    datasets: Sequence[Transitions],
    simulator: Simulator | None = None,
    sizes: tuple[int, int] | None = None,
    callbacks: Callbacks | None = None,
    chunk: int = 500,
    before_chunk: BeforeChunk | None = None,
    budget: BeforeChunk | None = None,
) -> Trained:
    """Train one run for each entry of `hyperparameters`, all in one compiled program.

    Args:
        static: Shared by all runs.
        hyperparameters: One entry for each run.
        datasets: Sets of demonstrations; `Hyperparameters.dataset` picks each run's. None without
            demonstrations; with `StaticConfig.demonstrators` one set of each of them for a run.
        simulator: The world to act in; None offline, or when `before_chunk` fills the replay.
        sizes: Features of an observation and number of actions; needed only where neither
            demonstrations nor a simulator tell.
        callbacks: Progress, monitor, checkpoint.
        chunk: Updates between two looks at the outside.
        before_chunk: Brings in experience from outside JAX (`learners.collect`).
        budget: Moves the multiplier (`learners.dial.budget`).

    Raises:
        UserError: If structure, data and world don't fit together.
        Stopped: On Ctrl-C.
    """
    sizes = check_fit(static, hyperparameters, datasets, simulator, sizes, before_chunk is not None)
    table = ExpertTable.of(datasets, "instantaneous", 1.0) if datasets else None
    callbacks = callbacks or Callbacks()
    world = simulator.description if simulator else "offline or collected"
    names = callbacks.run_names or tuple(f"dial, seed {one.seed}" for one in hyperparameters)
    callbacks = dataclasses.replace(callbacks, run_names=names)
    update_run = Partial(partial(update, static, simulator), table)
    runs, history = loop.run(
        initialise=Partial(partial(initialise, static, simulator, sizes)),
        update=update_run,
        hyperparameters=traced(hyperparameters),
        total=static.updates,
        chunk=chunk,
        fingerprint=loop.fingerprint(table, "dial", static, *hyperparameters, chunk, world),
        callbacks=callbacks,
        before_chunk=_in_turn(before_chunk, budget),
    )
    terms = loop.term_names(update_run, traced(hyperparameters), runs)
    failures = loop.failure_lines(runs, terms, names)
    multipliers = tuple(np.asarray(runs.surroundings.multiplier, np.float64).tolist())
    return Trained(
        static,
        tuple(hyperparameters),
        runs.learnt.target_network,
        runs.learnt.skill,
        multipliers,
        history,
        failures,
    )


def _in_turn(*hooks: BeforeChunk | None) -> BeforeChunk | None:
    """One after another, those that are given."""
    given = [hook for hook in hooks if hook is not None]

    def all_of(runs: Runs, done: int) -> Runs:
        for hook in given:
            runs = hook(runs, done)
        return runs

    return all_of if given else None


def traced(hyperparameters: Sequence[Hyperparameters]) -> Traced:
    """Stack the hyperparameters of the runs into arrays."""
    kinds = {"seed": jnp.uint32, "dataset": jnp.int32}
    return Traced(
        *(
            jnp.array([getattr(one, name) for one in hyperparameters], kinds.get(name, jnp.float32))
            for name in Traced._fields
        )
    )


def initialise(
    static: StaticConfig,
    simulator: Simulator | None,
    sizes: tuple[int, int],
    hyperparameters: Traced,
) -> tuple[Learnt, Surroundings]:
    """Draw a network and start episodes, from the run's seed alone."""
    key, for_network, for_acting = jax.random.split(jax.random.key(hyperparameters.seed), 3)
    n_features, n_actions = sizes
    network = DialNetwork.initialise(
        for_network,
        n_features,
        static.hidden,
        n_actions,
        static.activation,
        static.view,
        static.one_hot,
    )
    ring = replay.empty(static.replay_capacity, n_features) if static.online else None
    acting = begin(static, simulator, for_acting) if simulator else None
    skill = None
    if static.demonstrators:
        skill = QNetwork.initialise(
            jax.random.fold_in(for_network, 1),
            n_features,
            static.skill_hidden,
            n_actions,
            static.activation,
            static.view,
            static.one_hot,
        )
    adam = _ADAM.init(eqx.filter(Networks(network, skill), eqx.is_array))
    learnt = Learnt(network, network, skill, adam)
    return learnt, Surroundings(key, ring, acting, jnp.ones(()))


def update(
    static: StaticConfig,
    simulator: Simulator | None,
    table: ExpertTable | None,
    hyperparameters: Traced,
    learnt: Learnt,
    surroundings: Surroundings,
) -> tuple[Learnt, Surroundings, dict[str, Array]]:
    """Act, sample rows and angles, and take one Adam step on the objective."""
    key, for_acting, for_rows = jax.random.split(surroundings.key, 3)
    surroundings = surroundings._replace(key=key)
    hyperparameters = weighed(hyperparameters, surroundings.multiplier)
    if simulator is not None:
        ring, acting = surroundings.replay, surroundings.acting
        assert ring is not None and acting is not None  # `check_fit` asks for online training
        ring, acting = act(
            static, simulator, hyperparameters, learnt.network, ring, acting, for_acting
        )
        surroundings = surroundings._replace(replay=ring, acting=acting)
    rows = draw_rows(static, table, hyperparameters.dataset, surroundings.replay, for_rows)
    networks = Networks(learnt.network, learnt.skill)
    gradient, terms = jax.grad(objective, has_aux=True)(
        networks, learnt.target_network, rows, hyperparameters, static
    )
    direction, adam = _ADAM.update(gradient, learnt.adam)
    rate = hyperparameters.learning_rate * _cosine(
        learnt.adam.count, static, hyperparameters.final_rate
    )
    network, skill = jax.tree.map(lambda weight, step: weight - rate * step, networks, direction)
    target_network = jax.tree.map(
        lambda old, new: old + hyperparameters.polyak * (new - old), learnt.target_network, network
    )
    terms |= {"multiplier": surroundings.multiplier}
    return Learnt(network, target_network, skill, adam), surroundings, terms


def weighed(hyperparameters: Traced, multiplier: Array) -> Traced:
    """The numbers under a multiplier μ: weight μ w and temperature τ / μ.

    In the primal problem (docs/theory.md) the score then weighs μ times as much against the data's
    χ², while the entropy weighs what it did; and Q keeps its size.
    """
    return hyperparameters._replace(
        prior_weight=hyperparameters.prior_weight * multiplier,
        temperature=hyperparameters.temperature / multiplier,
    )


def _cosine(done: Array, static: StaticConfig, final: Array) -> Array:
    """Share of the learning rate after so many updates: 1 at first, `final` at the end."""
    return final + (1.0 - final) * 0.5 * (1.0 + jnp.cos(jnp.pi * done / static.updates))
