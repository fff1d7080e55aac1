"""Training: a run is a pure function of its structure, numbers, demonstrations and world."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
from jax.tree_util import Partial
from jaxtyping import Array, Float

from socialiq.errors import UserError
from socialiq.learners import loop, replay
from socialiq.learners.callbacks import Outside
from socialiq.learners.expert_table import Batch, ExpertTable
from socialiq.learners.iq_learn import priors
from socialiq.learners.iq_learn.config import Numbers, Structure
from socialiq.learners.iq_learn.objective import Batches, Traced, objective
from socialiq.learners.state import History, Lanes
from socialiq.nn.q_network import QNetwork, network_of
from socialiq.nn.q_policy import QPolicy
from socialiq.social.angle import exact_weights
from socialiq.types import Ending, RewardPair, Simulator, Transitions

_ADAM = optax.scale_by_adam()  # the traced learning rate is applied by hand


class Learnt(NamedTuple):
    """What training changes."""

    network: QNetwork
    slow: QNetwork
    adam: Any


class Surroundings(NamedTuple):
    """What an update carries along.

    Attributes:
        key: Random key.
        replay: The learner's own transitions; None offline.
        episode: The world's state; None offline.
        observation: Of that state; None offline.
        cumulative: Cumulative weights of Eq B.2; None without reweighting.
    """

    key: Array
    replay: replay.Replay | None
    episode: Any
    observation: Float[Array, " feature"] | None
    cumulative: Float[Array, " transition"] | None


@dataclass(frozen=True)
class Trained:
    """The outcome of a training call.

    Attributes:
        structure: Of all lanes.
        numbers: Of each lane.
        networks: The networks, arrays with a leading lane axis.
        history: What was recorded, (chunks, lanes).
        failures: One line for each lane that stopped early.
    """

    structure: Structure
    numbers: tuple[Numbers, ...]
    networks: QNetwork
    history: History
    failures: tuple[str, ...]

    def policy(self, lane: int) -> QPolicy:
        """The trained policy of one lane."""
        numbers = self.numbers[lane]
        record = {
            "learner": "iq_learn",
            "structure": dataclasses.asdict(self.structure),
            "numbers": dataclasses.asdict(numbers),
        }
        return QPolicy.of(network_of(self.networks, lane), numbers.temperature, record)


def train(
    structure: Structure,
    numbers: Sequence[Numbers],
    datasets: Sequence[Transitions],
    simulator: Simulator | None = None,
    outside: Outside | None = None,
    chunk: int = 500,
    before_chunk: Callable[[Lanes, int], Lanes] | None = None,
) -> Trained:
    """Train one lane for each of `numbers`, all in one compiled program.

    Args:
        structure: What the lanes share.
        numbers: What they differ in.
        datasets: Sets of demonstrations; `Numbers.dataset` picks each lane's.
        simulator: The world to act in; None offline, or when `before_chunk` fills the replay.
        outside: Progress, monitor, checkpoint.
        chunk: Updates between two looks at the outside.
        before_chunk: Brings in experience from outside JAX (`learners.collect`).

    Raises:
        UserError: If structure, data and world don't fit together.
        Stopped: On Ctrl-C.
    """
    check_fit(structure, numbers, datasets, simulator, before_chunk is not None)
    # Without a prior no returns are needed, and some data have none.
    kind = "instantaneous" if structure.prior == "none" else structure.target_kind
    table = ExpertTable.of(datasets, kind, structure.social_discount)
    sizes = (datasets[0].observation.shape[1], datasets[0].n_actions)
    outside = outside or Outside()
    world = simulator.description if simulator else "offline or collected"
    names = outside.lane_names or tuple(lane_name(one) for one in numbers)
    outside = dataclasses.replace(outside, lane_names=names)
    update_lane = Partial(partial(update, structure, simulator), table)
    lanes, history = loop.run(
        initialise=Partial(partial(initialise, structure, simulator, sizes), table),
        update=update_lane,
        numbers=traced(numbers),
        total=structure.updates,
        chunk=chunk,
        fingerprint=loop.fingerprint(table, structure, *numbers, chunk, world),
        outside=outside,
        before_chunk=before_chunk,
    )
    terms = loop.term_names(update_lane, traced(numbers), lanes)
    failures = loop.failure_lines(lanes, terms, names)
    return Trained(structure, tuple(numbers), lanes.learnt.network, history, failures)


def lane_name(numbers: Numbers) -> str:
    """How messages call a lane."""
    return f"angle {numbers.angle:g}, strength {numbers.strength:g}, seed {numbers.seed}"


def traced(numbers: Sequence[Numbers]) -> Traced:
    """Stack the lanes' numbers into arrays."""
    pairs = [exact_weights(one.angle) for one in numbers]

    def column(name: str, dtype: Any = jnp.float32) -> Array:
        return jnp.array([getattr(one, name) for one in numbers], dtype)

    weights = RewardPair(
        env=jnp.array([pair.env for pair in pairs], jnp.float32),
        social=jnp.array([pair.social for pair in pairs], jnp.float32),
    )
    integers = {"seed": column("seed", jnp.uint32), "dataset": column("dataset", jnp.int32)}
    floats = {name: column(name) for name in Traced._fields if name not in (*integers, "weights")}
    return Traced(weights=weights, **floats, **integers)


def initialise(
    structure: Structure,
    simulator: Simulator | None,
    sizes: tuple[int, int],
    table: ExpertTable,
    numbers: Traced,
) -> tuple[Learnt, Surroundings]:
    """Draw a network and start an episode, from the lane's seed alone."""
    key, for_network, for_world = jax.random.split(jax.random.key(numbers.seed), 3)
    n_features, n_actions = sizes
    network = QNetwork.initialise(
        for_network, n_features, structure.hidden, n_actions, structure.activation, structure.view
    )
    episode, observation = simulator.reset(for_world) if simulator else (None, None)
    ring = replay.empty(structure.replay_capacity, n_features) if structure.online else None
    cumulative = None
    if structure.prior == "reweighting":
        found = priors.table_weights(
            table, numbers.weights, numbers.dataset, numbers.reweight_temperature
        )
        cumulative = jnp.cumsum(found)
    learnt = Learnt(network, network, _ADAM.init(eqx.filter(network, eqx.is_array)))
    return learnt, Surroundings(key, ring, episode, observation, cumulative)


def update(
    structure: Structure,
    simulator: Simulator | None,
    table: ExpertTable,
    numbers: Traced,
    learnt: Learnt,
    surroundings: Surroundings,
) -> tuple[Learnt, Surroundings, dict[str, Array]]:
    """Act, sample, and take one Adam step on the objective."""
    key, for_acting, for_expert, for_replay, for_initial = jax.random.split(surroundings.key, 5)
    surroundings = surroundings._replace(key=key)
    if simulator is not None:
        surroundings = _act(structure, simulator, numbers, learnt, surroundings, for_acting)
    batches = Batches(
        expert=_expert_batch(structure, table, numbers, surroundings, for_expert),
        replay=replay.sample(surroundings.replay, for_replay, structure.batch_size)
        if surroundings.replay is not None
        else None,
        initial=table.sample_initial(for_initial, numbers.dataset, structure.batch_size)
        if structure.value_term == "v0"
        else None,
    )
    gradient, terms = jax.grad(objective, has_aux=True)(
        learnt.network, learnt.slow, batches, numbers, structure
    )
    direction, adam = _ADAM.update(gradient, learnt.adam)
    network = jax.tree.map(
        lambda weight, step: weight - numbers.learning_rate * step, learnt.network, direction
    )
    slow = jax.tree.map(lambda old, new: old + numbers.polyak * (new - old), learnt.slow, network)
    return Learnt(network, slow, adam), surroundings, terms


def _expert_batch(
    structure: Structure,
    table: ExpertTable,
    numbers: Traced,
    surroundings: Surroundings,
    key: Array,
) -> Batch:
    if surroundings.cumulative is not None:
        return table.sample_weighted(key, surroundings.cumulative, structure.batch_size)
    return table.sample(key, numbers.dataset, structure.batch_size)


def _act(
    structure: Structure,
    simulator: Simulator,
    numbers: Traced,
    learnt: Learnt,
    surroundings: Surroundings,
    key: Array,
) -> Surroundings:
    """Take steps in the world with the soft policy, into the replay."""
    ring, observation, episode = (
        surroundings.replay,
        surroundings.observation,
        surroundings.episode,
    )
    assert ring is not None and observation is not None  # `check_fit` asks for online training
    for one in jax.random.split(key, structure.env_steps_per_update):
        for_action, for_step, for_reset = jax.random.split(one, 3)
        q = learnt.network(observation)
        action = jax.random.categorical(for_action, q / numbers.temperature)
        follows, step = simulator.advance(for_step, episode, action)
        transition = Batch(observation, action, step.observation, step.ending, step.rewards)
        ring = replay.add(ring, transition)
        ended = step.ending != int(Ending.NONE)
        episode, observation = jax.tree.map(
            lambda new, old, ended=ended: jnp.where(ended, new, old),
            simulator.reset(for_reset),
            (follows, step.observation),
        )
    return surroundings._replace(replay=ring, episode=episode, observation=observation)


def check_fit(
    structure: Structure,
    numbers: Sequence[Numbers],
    datasets: Sequence[Transitions],
    simulator: Simulator | None,
    collects: bool,
) -> None:
    """Refuse runs whose settings, data and world don't fit together, before any work is done.

    Args:
        structure: What the lanes share.
        numbers: What they differ in.
        datasets: Sets of demonstrations.
        simulator: The world, if there is one.
        collects: Whether experience comes from outside JAX.

    Raises:
        UserError: The line says what doesn't fit.
    """
    if not numbers:
        raise UserError("no runs: pass at least one set of numbers")
    if not datasets:
        raise UserError("no demonstrations: pass at least one set")
    if max(one.dataset for one in numbers) >= len(datasets):
        raise UserError(f"a run names a set of demonstrations beyond the {len(datasets)} given")
    if structure.online and simulator is None and not collects:
        raise UserError("online training needs a world: name one, or train offline")
    if structure.prior != "none":
        for data in datasets:  # raises where returns aren't known
            data.returns(structure.target_kind, structure.social_discount)
    if not structure.online and (simulator is not None or collects):
        raise UserError("offline training takes no world: drop it, or train online")
    if simulator is not None:
        wanted = (simulator.n_features, simulator.n_actions)
        given = (datasets[0].observation.shape[1], datasets[0].n_actions)
        if wanted != given:
            raise UserError(
                f"the demonstrations have {given[0]} features and {given[1]} actions, "
                f"the world has {wanted[0]} and {wanted[1]}: they belong to another world"
            )
