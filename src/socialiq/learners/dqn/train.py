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
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.collect import Act, Behaviour, Collector, Source
from socialiq.learners.dqn import losses
from socialiq.learners.dqn.config import Hyperparameters, StaticConfig
from socialiq.learners.expert_table import Batch
from socialiq.learners.state import History
from socialiq.nn.q_network import QNetwork, network_of
from socialiq.nn.q_policy import QPolicy
from socialiq.social.angle import exact_weights, score
from socialiq.types import RewardPair

_ADAM = optax.scale_by_adam()  # the traced learning rate is applied by hand


class Traced(NamedTuple):
    """`Hyperparameters` as arrays, with the angle's weights in place of the angle."""

    weights: RewardPair
    discount: Array
    learning_rate: Array
    final_learning_rate: Array
    polyak: Array
    seed: Array


class Learnt(NamedTuple):
    """What training changes."""

    network: QNetwork
    target_network: QNetwork
    adam: Any


class Surroundings(NamedTuple):
    """What an update carries along: a random key and the replay."""

    key: Array
    replay: replay.Replay


@dataclass(frozen=True)
class Trained:
    """The outcome: one network for each of `numbers`.

    Attributes:
        static: Of all runs.
        hyperparameters: Of each run.
        networks: The networks, arrays with a leading run axis.
        history: What was recorded, (chunks, runs).
        failures: One line for each run that stopped early.
    """

    static: StaticConfig
    hyperparameters: tuple[Hyperparameters, ...]
    networks: QNetwork
    history: History
    failures: tuple[str, ...]

    def policy(self, run: int) -> QPolicy:
        """The policy of one run after the last update."""
        return policy_of(self.static, self.hyperparameters[run], network_of(self.networks, run))


def policy_of(static: StaticConfig, hyperparameters: Hyperparameters, network: QNetwork) -> QPolicy:
    """A network as a policy with its record; its soft form, at τ = 1, means nothing."""
    record = {
        "learner": "dqn",
        "structure": dataclasses.asdict(static),
        "numbers": dataclasses.asdict(hyperparameters),
    }
    return QPolicy.of(network, 1.0, record)


def train(
    static: StaticConfig,
    hyperparameters: Sequence[Hyperparameters],
    sources: Sequence[Source],
    sizes: tuple[int, int],
    callbacks: Callbacks | None = None,
    chunk: int = 200,
) -> Trained:
    """Train one run for each entry of `hyperparameters`, all in one compiled program.

    Args:
        static: Shared by all runs.
        hyperparameters: One entry for each run.
        sources: Where each run acts; `learners.collect` makes them, for
            `chunk * structure.steps_per_update` steps.
        sizes: Features of an observation, and number of actions.
        callbacks: Progress, monitor, checkpoint.
        chunk: Updates between two looks at the outside, and between two rounds of acting.

    Raises:
        UserError: If there is no run, or not one source for each.
        Stopped: On Ctrl-C.
    """
    if not hyperparameters or len(sources) != len(hyperparameters):
        raise UserError(
            f"{len(hyperparameters)} runs and {len(sources)} sources: pass one for each"
        )
    callbacks = callbacks or Callbacks()
    names = callbacks.run_names or tuple(
        f"angle {n.angle:g}, seed {n.seed}" for n in hyperparameters
    )
    update_run = partial(update, static)
    runs, history = loop.run(
        initialise=partial(initialise, static, sizes),
        update=update_run,
        hyperparameters=traced(hyperparameters),
        total=static.updates,
        chunk=chunk,
        fingerprint=loop.fingerprint((), static, *hyperparameters, chunk),
        callbacks=dataclasses.replace(callbacks, run_names=names),
        before_chunk=Collector(
            sources, [n.seed for n in hyperparameters], acting(static, hyperparameters)
        ),
    )
    terms = loop.term_names(update_run, traced(hyperparameters), runs)
    failures = loop.failure_lines(runs, terms, names)
    return Trained(static, tuple(hyperparameters), runs.learnt.network, history, failures)


def acting(static: StaticConfig, hyperparameters: Sequence[Hyperparameters]) -> Behaviour:
    """ε-greedy, ε by the share of the run that is done."""

    def behaviour(network: QNetwork, run: int, done: int, rng: np.random.Generator) -> Act:
        policy = QPolicy.of(network, 1.0, {})
        share = hyperparameters[run].exploring(done / static.updates)

        def act(observation: np.ndarray) -> np.ndarray:
            random = rng.integers(policy.n_actions, size=len(observation))
            explore = rng.random(len(observation)) < share
            return np.where(explore, random, policy.predict(observation)[0])

        return act

    return behaviour


def traced(hyperparameters: Sequence[Hyperparameters]) -> Traced:
    """Stack the hyperparameters of the runs into arrays."""
    pairs = [exact_weights(one.angle) for one in hyperparameters]

    def column(values: Sequence[float | int], kind: Any = jnp.float32) -> Array:
        return jnp.array(values, kind)

    names = ("discount", "learning_rate", "final_learning_rate", "polyak")
    return Traced(
        RewardPair(column([p.env for p in pairs]), column([p.social for p in pairs])),
        *(column([getattr(one, name) for one in hyperparameters]) for name in names),
        seed=column([one.seed for one in hyperparameters], jnp.uint32),
    )


def initialise(
    static: StaticConfig, sizes: tuple[int, int], hyperparameters: Traced
) -> tuple[Learnt, Surroundings]:
    """Draw a network from the run's seed, beside an empty replay."""
    key, for_network = jax.random.split(jax.random.key(hyperparameters.seed))
    n_features, n_actions = sizes
    network = QNetwork.initialise(
        for_network, n_features, static.hidden, n_actions, static.activation, static.view
    )
    ring = replay.empty(static.replay_capacity, n_features)
    adam = _ADAM.init(eqx.filter(network, eqx.is_array))
    return Learnt(network, network, adam), Surroundings(key, ring)


def update(
    static: StaticConfig, hyperparameters: Traced, learnt: Learnt, surroundings: Surroundings
) -> tuple[Learnt, Surroundings, dict[str, Array]]:
    """Sample, and take one Adam step on the temporal-difference loss."""
    key, for_batch = jax.random.split(surroundings.key)
    batch = replay.sample(surroundings.replay, for_batch, static.batch_size)
    (loss, max_q), gradient = jax.value_and_grad(_loss, has_aux=True)(
        learnt.network, learnt.target_network, batch, hyperparameters, static
    )
    direction, adam = _ADAM.update(gradient, learnt.adam)
    done = (learnt.adam.count + 1) / static.updates
    rate = hyperparameters.learning_rate + done * (
        hyperparameters.final_learning_rate - hyperparameters.learning_rate
    )
    network = jax.tree.map(lambda weight, step: weight - rate * step, learnt.network, direction)
    target_network = jax.tree.map(
        lambda old, new: old + hyperparameters.polyak * (new - old), learnt.target_network, network
    )
    terms = {"loss": loss, "max_q": max_q}
    return Learnt(network, target_network, adam), surroundings._replace(key=key), terms


def _loss(
    network: QNetwork,
    target_network: QNetwork,
    batch: Batch,
    hyperparameters: Traced,
    static: StaticConfig,
) -> tuple[Array, Array]:
    fast = jax.vmap(network)(batch.next_observation) if static.double else None
    steady = jax.vmap(target_network)(batch.next_observation)
    value = losses.next_value(steady, steady if fast is None else fast, static.double)
    target = jax.lax.stop_gradient(
        losses.bootstrapped_target(
            score(hyperparameters.weights, batch.target),
            value,
            batch.ending,
            hyperparameters.discount,
            static.through_timeouts,
        )
    )
    q = jax.vmap(network)(batch.observation)
    return losses.td_loss(q, batch.action, target), jnp.max(jnp.abs(q))
