"""Training: collect a chunk by ε-greedy acting, learn a chunk in one compiled scan (thesis 5.2)."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array

from socialiq.errors import UserError
from socialiq.learners import loop, replay
from socialiq.learners.callbacks import Outside
from socialiq.learners.collect import Act, Behaviour, Collector, Source
from socialiq.learners.dqn import losses
from socialiq.learners.dqn.config import Numbers, Structure
from socialiq.learners.expert_table import Batch
from socialiq.learners.state import History
from socialiq.nn.q_network import QNetwork, network_of
from socialiq.nn.q_policy import QPolicy
from socialiq.social.angle import exact_weights
from socialiq.social.score import score
from socialiq.types import RewardPair

_ADAM = optax.scale_by_adam()  # the traced learning rate is applied by hand


class Traced(NamedTuple):
    """`Numbers` as arrays, with the angle's weights in place of the angle."""

    weights: RewardPair
    discount: Array
    learning_rate: Array
    final_learning_rate: Array
    polyak: Array
    seed: Array


class Learnt(NamedTuple):
    """What training changes."""

    network: QNetwork
    slow: QNetwork
    adam: Any


class Surroundings(NamedTuple):
    """What an update carries along: a random key and the replay."""

    key: Array
    replay: replay.Replay


@dataclass(frozen=True)
class Trained:
    """The outcome: one network for each of `numbers`.

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
        """The policy of one lane after the last update."""
        return policy_of(self.structure, self.numbers[lane], network_of(self.networks, lane))


def policy_of(structure: Structure, numbers: Numbers, network: QNetwork) -> QPolicy:
    """A network as a policy with its record; its soft form, at τ = 1, means nothing."""
    record = {
        "learner": "dqn",
        "structure": dataclasses.asdict(structure),
        "numbers": dataclasses.asdict(numbers),
    }
    return QPolicy.of(network, 1.0, record)


def train(
    structure: Structure,
    numbers: Sequence[Numbers],
    sources: Sequence[Source],
    sizes: tuple[int, int],
    outside: Outside | None = None,
    chunk: int = 200,
) -> Trained:
    """Train one lane for each of `numbers`, all in one compiled program.

    Args:
        structure: What the lanes share.
        numbers: What they differ in.
        sources: Where each lane acts; `learners.collect` makes them, for
            `chunk * structure.steps_per_update` steps.
        sizes: Features of an observation, and number of actions.
        outside: Progress, monitor, checkpoint.
        chunk: Updates between two looks at the outside, and between two rounds of acting.

    Raises:
        UserError: If there is no run, or not one source for each.
        Stopped: On Ctrl-C.
    """
    if not numbers or len(sources) != len(numbers):
        raise UserError(f"{len(numbers)} runs and {len(sources)} sources: pass one for each")
    outside = outside or Outside()
    names = outside.lane_names or tuple(f"angle {n.angle:g}, seed {n.seed}" for n in numbers)
    update_lane = partial(update, structure)
    lanes, history = loop.run(
        initialise=partial(initialise, structure, sizes),
        update=update_lane,
        numbers=traced(numbers),
        total=structure.updates,
        chunk=chunk,
        fingerprint=loop.fingerprint((), structure, *numbers, chunk),
        outside=dataclasses.replace(outside, lane_names=names),
        before_chunk=Collector(sources, [n.seed for n in numbers], acting(structure, numbers)),
    )
    terms = loop.term_names(update_lane, traced(numbers), lanes)
    failures = loop.failure_lines(lanes, terms, names)
    return Trained(structure, tuple(numbers), lanes.learnt.network, history, failures)


def acting(structure: Structure, numbers: Sequence[Numbers]) -> Behaviour:
    """ε-greedy, ε by the share of the run that is done."""

    def behaviour(network: QNetwork, lane: int, done: int, rng: np.random.Generator) -> Act:
        policy = QPolicy.of(network, 1.0, {})
        share = numbers[lane].exploring(done / structure.updates)

        def act(observation: np.ndarray) -> np.ndarray:
            random = rng.integers(policy.n_actions, size=len(observation))
            explore = rng.random(len(observation)) < share
            return np.where(explore, random, policy.predict(observation)[0])

        return act

    return behaviour


def traced(numbers: Sequence[Numbers]) -> Traced:
    """Stack the lanes' numbers into arrays."""
    pairs = [exact_weights(one.angle) for one in numbers]

    def column(values: Sequence[float | int], kind: Any = jnp.float32) -> Array:
        return jnp.array(values, kind)

    names = ("discount", "learning_rate", "final_learning_rate", "polyak")
    return Traced(
        RewardPair(column([p.env for p in pairs]), column([p.social for p in pairs])),
        *(column([getattr(one, name) for one in numbers]) for name in names),
        seed=column([one.seed for one in numbers], jnp.uint32),
    )


def initialise(
    structure: Structure, sizes: tuple[int, int], numbers: Traced
) -> tuple[Learnt, Surroundings]:
    """Draw a network from the lane's seed, beside an empty replay."""
    key, for_network = jax.random.split(jax.random.key(numbers.seed))
    n_features, n_actions = sizes
    network = QNetwork.initialise(
        for_network, n_features, structure.hidden, n_actions, structure.activation, structure.view
    )
    ring = replay.empty(structure.replay_capacity, n_features)
    adam = _ADAM.init(eqx.filter(network, eqx.is_array))
    return Learnt(network, network, adam), Surroundings(key, ring)


def update(
    structure: Structure, numbers: Traced, learnt: Learnt, surroundings: Surroundings
) -> tuple[Learnt, Surroundings, dict[str, Array]]:
    """Sample, and take one Adam step on the temporal-difference loss."""
    key, for_batch = jax.random.split(surroundings.key)
    batch = replay.sample(surroundings.replay, for_batch, structure.batch_size)
    (loss, max_q), gradient = jax.value_and_grad(_loss, has_aux=True)(
        learnt.network, learnt.slow, batch, numbers, structure
    )
    direction, adam = _ADAM.update(gradient, learnt.adam)
    done = (learnt.adam.count + 1) / structure.updates
    rate = numbers.learning_rate + done * (numbers.final_learning_rate - numbers.learning_rate)
    network = jax.tree.map(lambda weight, step: weight - rate * step, learnt.network, direction)
    slow = jax.tree.map(lambda old, new: old + numbers.polyak * (new - old), learnt.slow, network)
    terms = {"loss": loss, "max_q": max_q}
    return Learnt(network, slow, adam), surroundings._replace(key=key), terms


def _loss(
    network: QNetwork, slow: QNetwork, batch: Batch, numbers: Traced, structure: Structure
) -> tuple[Array, Array]:
    fast = jax.vmap(network)(batch.next_observation) if structure.double else None
    steady = jax.vmap(slow)(batch.next_observation)
    value = losses.next_value(steady, steady if fast is None else fast, structure.double)
    target = jax.lax.stop_gradient(
        losses.bootstrapped_target(
            score(numbers.weights, batch.target),
            value,
            batch.ending,
            numbers.discount,
            structure.through_timeouts,
        )
    )
    q = jax.vmap(network)(batch.observation)
    return losses.td_loss(q, batch.action, target), jnp.max(jnp.abs(q))
