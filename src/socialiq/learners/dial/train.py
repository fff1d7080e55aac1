"""Training of the dial: one network for a range of angles, many lanes in one compiled program."""

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
from socialiq.learners.callbacks import Outside
from socialiq.learners.dial.acting import Acting, act, begin
from socialiq.learners.dial.config import Numbers, Structure, check_fit
from socialiq.learners.dial.objective import Networks, Traced, objective
from socialiq.learners.dial.rows import draw_rows
from socialiq.learners.expert_table import ExpertTable
from socialiq.learners.state import History, Lanes
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_network import QNetwork, network_of
from socialiq.types import Simulator, Transitions

BeforeChunk = Callable[[Lanes, int], Lanes]
"""Called with the lanes and the number of updates done, before each chunk."""

_ADAM = optax.scale_by_adam()  # the traced learning rate is applied by hand


class Learnt(NamedTuple):
    """What training changes; `slow` is what a policy is made of."""

    network: DialNetwork
    slow: DialNetwork
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
        structure: Of all lanes.
        numbers: Of each lane.
        networks: The slow copies, arrays with a leading lane axis.
        skills: What the demonstrators share, f; None if no demonstrators are told.
        multipliers: Of each lane at the end, 1 without a budget.
        history: What was recorded, (chunks, lanes).
        failures: One line for each lane that stopped early.
    """

    structure: Structure
    numbers: tuple[Numbers, ...]
    networks: DialNetwork
    skills: QNetwork | None
    multipliers: tuple[float, ...]
    history: History
    failures: tuple[str, ...]

    def dial(self, lane: int) -> DialPolicy:
        """The trained dial of one lane."""
        network = network_of(self.networks, lane)
        return dial_of(self.structure, self.numbers[lane], network, self.multipliers[lane])


def dial_of(
    structure: Structure, numbers: Numbers, network: DialNetwork, multiplier: float = 1.0
) -> DialPolicy:
    """A network as a dial with its record."""
    record = {
        "learner": "dial",
        "structure": dataclasses.asdict(structure),
        "numbers": dataclasses.asdict(numbers),
        "multiplier": multiplier,
    }
    temperature = numbers.temperature / multiplier
    return DialPolicy.of(network, temperature, structure.low, structure.high, record)


def train(
    structure: Structure,
    numbers: Sequence[Numbers],
    datasets: Sequence[Transitions],
    simulator: Simulator | None = None,
    sizes: tuple[int, int] | None = None,
    outside: Outside | None = None,
    chunk: int = 500,
    before_chunk: BeforeChunk | None = None,
    budget: BeforeChunk | None = None,
) -> Trained:
    """Train one lane for each of `numbers`, all in one compiled program.

    Args:
        structure: What the lanes share.
        numbers: What they differ in.
        datasets: Sets of demonstrations; `Numbers.dataset` picks each lane's. None without
            demonstrations; with `Structure.demonstrators` one set of each of them for a lane.
        simulator: The world to act in; None offline, or when `before_chunk` fills the replay.
        sizes: Features of an observation and number of actions; needed only where neither
            demonstrations nor a simulator tell.
        outside: Progress, monitor, checkpoint.
        chunk: Updates between two looks at the outside.
        before_chunk: Brings in experience from outside JAX (`learners.collect`).
        budget: Moves the multiplier (`learners.dial.budget`).

    Raises:
        UserError: If structure, data and world don't fit together.
        Stopped: On Ctrl-C.
    """
    sizes = check_fit(structure, numbers, datasets, simulator, sizes, before_chunk is not None)
    table = ExpertTable.of(datasets, "instantaneous", 1.0) if datasets else None
    outside = outside or Outside()
    world = simulator.description if simulator else "offline or collected"
    names = outside.lane_names or tuple(f"dial, seed {one.seed}" for one in numbers)
    outside = dataclasses.replace(outside, lane_names=names)
    update_lane = Partial(partial(update, structure, simulator), table)
    lanes, history = loop.run(
        initialise=Partial(partial(initialise, structure, simulator, sizes)),
        update=update_lane,
        numbers=traced(numbers),
        total=structure.updates,
        chunk=chunk,
        fingerprint=loop.fingerprint(table, "dial", structure, *numbers, chunk, world),
        outside=outside,
        before_chunk=_in_turn(before_chunk, budget),
    )
    terms = loop.term_names(update_lane, traced(numbers), lanes)
    failures = loop.failure_lines(lanes, terms, names)
    multipliers = tuple(np.asarray(lanes.surroundings.multiplier, np.float64).tolist())
    return Trained(
        structure,
        tuple(numbers),
        lanes.learnt.slow,
        lanes.learnt.skill,
        multipliers,
        history,
        failures,
    )


def _in_turn(*hooks: BeforeChunk | None) -> BeforeChunk | None:
    """One after another, those that are given."""
    given = [hook for hook in hooks if hook is not None]

    def all_of(lanes: Lanes, done: int) -> Lanes:
        for hook in given:
            lanes = hook(lanes, done)
        return lanes

    return all_of if given else None


def traced(numbers: Sequence[Numbers]) -> Traced:
    """Stack the lanes' numbers into arrays."""
    kinds = {"seed": jnp.uint32, "dataset": jnp.int32}
    return Traced(
        *(
            jnp.array([getattr(one, name) for one in numbers], kinds.get(name, jnp.float32))
            for name in Traced._fields
        )
    )


def initialise(
    structure: Structure, simulator: Simulator | None, sizes: tuple[int, int], numbers: Traced
) -> tuple[Learnt, Surroundings]:
    """Draw a network and start episodes, from the lane's seed alone."""
    key, for_network, for_acting = jax.random.split(jax.random.key(numbers.seed), 3)
    n_features, n_actions = sizes
    network = DialNetwork.initialise(
        for_network,
        n_features,
        structure.hidden,
        n_actions,
        structure.activation,
        structure.view,
        structure.one_hot,
    )
    ring = replay.empty(structure.replay_capacity, n_features) if structure.online else None
    acting = begin(structure, simulator, for_acting) if simulator else None
    skill = None
    if structure.demonstrators:
        skill = QNetwork.initialise(
            jax.random.fold_in(for_network, 1),
            n_features,
            structure.skill_hidden,
            n_actions,
            structure.activation,
            structure.view,
            structure.one_hot,
        )
    adam = _ADAM.init(eqx.filter(Networks(network, skill), eqx.is_array))
    learnt = Learnt(network, network, skill, adam)
    return learnt, Surroundings(key, ring, acting, jnp.ones(()))


def update(
    structure: Structure,
    simulator: Simulator | None,
    table: ExpertTable | None,
    numbers: Traced,
    learnt: Learnt,
    surroundings: Surroundings,
) -> tuple[Learnt, Surroundings, dict[str, Array]]:
    """Act, sample rows and angles, and take one Adam step on the objective."""
    key, for_acting, for_rows = jax.random.split(surroundings.key, 3)
    surroundings = surroundings._replace(key=key)
    numbers = weighed(numbers, surroundings.multiplier)
    if simulator is not None:
        ring, acting = surroundings.replay, surroundings.acting
        assert ring is not None and acting is not None  # `check_fit` asks for online training
        ring, acting = act(structure, simulator, numbers, learnt.network, ring, acting, for_acting)
        surroundings = surroundings._replace(replay=ring, acting=acting)
    rows = draw_rows(structure, table, numbers.dataset, surroundings.replay, for_rows)
    networks = Networks(learnt.network, learnt.skill)
    gradient, terms = jax.grad(objective, has_aux=True)(
        networks, learnt.slow, rows, numbers, structure
    )
    direction, adam = _ADAM.update(gradient, learnt.adam)
    rate = numbers.learning_rate * _cosine(learnt.adam.count, structure, numbers.final_rate)
    network, skill = jax.tree.map(lambda weight, step: weight - rate * step, networks, direction)
    slow = jax.tree.map(lambda old, new: old + numbers.polyak * (new - old), learnt.slow, network)
    terms |= {"multiplier": surroundings.multiplier}
    return Learnt(network, slow, skill, adam), surroundings, terms


def weighed(numbers: Traced, multiplier: Array) -> Traced:
    """The numbers under a multiplier μ: weight μ w and temperature τ / μ.

    In the primal problem (docs/theory.md) the score then weighs μ times as much against the data's
    χ², while the entropy weighs what it did; and Q keeps its size.
    """
    return numbers._replace(
        prior_weight=numbers.prior_weight * multiplier,
        temperature=numbers.temperature / multiplier,
    )


def _cosine(done: Array, structure: Structure, final: Array) -> Array:
    """Share of the learning rate after so many updates: 1 at first, `final` at the end."""
    return final + (1.0 - final) * 0.5 * (1.0 + jnp.cos(jnp.pi * done / structure.updates))
