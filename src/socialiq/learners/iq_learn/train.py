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
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.expert_table import Batch, ExpertTable
from socialiq.learners.iq_learn import priors
from socialiq.learners.iq_learn.config import Hyperparameters, StaticConfig
from socialiq.learners.iq_learn.objective import Batches, Traced, objective
from socialiq.learners.state import History, Runs
from socialiq.nn.q_network import QNetwork, network_of
from socialiq.nn.q_policy import QPolicy
from socialiq.social.angle import exact_weights
from socialiq.types import Ending, RewardPair, Simulator, Transitions

_ADAM = optax.scale_by_adam()  # the traced learning rate is applied by hand


class Learnt(NamedTuple):
    """What training changes."""

    network: QNetwork
    target_network: QNetwork
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
        """The trained policy of one run."""
        hyperparameters = self.hyperparameters[run]
        record = {
            "learner": "iq_learn",
            "structure": dataclasses.asdict(self.static),
            "numbers": dataclasses.asdict(hyperparameters),
        }
        return QPolicy.of(network_of(self.networks, run), hyperparameters.temperature, record)


def train(
    static: StaticConfig,
    hyperparameters: Sequence[Hyperparameters],
    datasets: Sequence[Transitions],
    simulator: Simulator | None = None,
    callbacks: Callbacks | None = None,
    chunk: int = 500,
    before_chunk: Callable[[Runs, int], Runs] | None = None,
) -> Trained:
    """Train one run for each entry of `hyperparameters`, all in one compiled program.

    Args:
        static: Shared by all runs.
        hyperparameters: One entry for each run.
        datasets: Sets of demonstrations; `Hyperparameters.dataset` picks each run's.
        simulator: The world to act in; None offline, or when `before_chunk` fills the replay.
        callbacks: Progress, monitor, checkpoint.
        chunk: Updates between two looks at the outside.
        before_chunk: Brings in experience from outside JAX (`learners.collect`).

    Raises:
        UserError: If structure, data and world don't fit together.
        Stopped: On Ctrl-C.
    """
    check_fit(static, hyperparameters, datasets, simulator, before_chunk is not None)
    # Without a prior no returns are needed, and some data have none.
    kind = "instantaneous" if static.prior == "none" else static.target_kind
    table = ExpertTable.of(datasets, kind, static.social_discount)
    sizes = (datasets[0].observation.shape[1], datasets[0].n_actions)
    callbacks = callbacks or Callbacks()
    world = simulator.description if simulator else "offline or collected"
    names = callbacks.run_names or tuple(run_name(one) for one in hyperparameters)
    callbacks = dataclasses.replace(callbacks, run_names=names)
    update_run = Partial(partial(update, static, simulator), table)
    runs, history = loop.run(
        initialise=Partial(partial(initialise, static, simulator, sizes), table),
        update=update_run,
        hyperparameters=traced(hyperparameters),
        total=static.updates,
        chunk=chunk,
        fingerprint=loop.fingerprint(table, static, *hyperparameters, chunk, world),
        callbacks=callbacks,
        before_chunk=before_chunk,
    )
    terms = loop.term_names(update_run, traced(hyperparameters), runs)
    failures = loop.failure_lines(runs, terms, names)
    return Trained(static, tuple(hyperparameters), runs.learnt.network, history, failures)


def run_name(of: Hyperparameters) -> str:
    """Return the name of a run in messages."""
    return f"angle {of.angle:g}, strength {of.strength:g}, seed {of.seed}"


def traced(hyperparameters: Sequence[Hyperparameters]) -> Traced:
    """Stack the hyperparameters of the runs into arrays."""
    pairs = [exact_weights(one.angle) for one in hyperparameters]

    def column(name: str, dtype: Any = jnp.float32) -> Array:
        return jnp.array([getattr(one, name) for one in hyperparameters], dtype)

    weights = RewardPair(
        env=jnp.array([pair.env for pair in pairs], jnp.float32),
        social=jnp.array([pair.social for pair in pairs], jnp.float32),
    )
    integers = {"seed": column("seed", jnp.uint32), "dataset": column("dataset", jnp.int32)}
    floats = {name: column(name) for name in Traced._fields if name not in (*integers, "weights")}
    return Traced(weights=weights, **floats, **integers)


def initialise(
    static: StaticConfig,
    simulator: Simulator | None,
    sizes: tuple[int, int],
    table: ExpertTable,
    hyperparameters: Traced,
) -> tuple[Learnt, Surroundings]:
    """Draw a network and start an episode, from the run's seed alone."""
    key, for_network, for_world = jax.random.split(jax.random.key(hyperparameters.seed), 3)
    n_features, n_actions = sizes
    network = QNetwork.initialise(
        for_network, n_features, static.hidden, n_actions, static.activation, static.view
    )
    episode, observation = simulator.reset(for_world) if simulator else (None, None)
    ring = replay.empty(static.replay_capacity, n_features) if static.online else None
    cumulative = None
    if static.prior == "reweighting":
        found = priors.table_weights(
            table,
            hyperparameters.weights,
            hyperparameters.dataset,
            hyperparameters.reweight_temperature,
        )
        cumulative = jnp.cumsum(found)
    learnt = Learnt(network, network, _ADAM.init(eqx.filter(network, eqx.is_array)))
    return learnt, Surroundings(key, ring, episode, observation, cumulative)


def update(
    static: StaticConfig,
    simulator: Simulator | None,
    table: ExpertTable,
    hyperparameters: Traced,
    learnt: Learnt,
    surroundings: Surroundings,
) -> tuple[Learnt, Surroundings, dict[str, Array]]:
    """Act, sample, and take one Adam step on the objective."""
    key, for_acting, for_expert, for_replay, for_initial = jax.random.split(surroundings.key, 5)
    surroundings = surroundings._replace(key=key)
    if simulator is not None:
        surroundings = _act(static, simulator, hyperparameters, learnt, surroundings, for_acting)
    batches = Batches(
        expert=_expert_batch(static, table, hyperparameters, surroundings, for_expert),
        replay=replay.sample(surroundings.replay, for_replay, static.batch_size)
        if surroundings.replay is not None
        else None,
        initial=table.sample_initial(for_initial, hyperparameters.dataset, static.batch_size)
        if static.value_term == "v0"
        else None,
    )
    gradient, terms = jax.grad(objective, has_aux=True)(
        learnt.network, learnt.target_network, batches, hyperparameters, static
    )
    direction, adam = _ADAM.update(gradient, learnt.adam)
    network = jax.tree.map(
        lambda weight, step: weight - hyperparameters.learning_rate * step,
        learnt.network,
        direction,
    )
    target_network = jax.tree.map(
        lambda old, new: old + hyperparameters.polyak * (new - old), learnt.target_network, network
    )
    return Learnt(network, target_network, adam), surroundings, terms


def _expert_batch(
    static: StaticConfig,
    table: ExpertTable,
    hyperparameters: Traced,
    surroundings: Surroundings,
    key: Array,
) -> Batch:
    if surroundings.cumulative is not None:
        return table.sample_weighted(key, surroundings.cumulative, static.batch_size)
    return table.sample(key, hyperparameters.dataset, static.batch_size)


def _act(
    static: StaticConfig,
    simulator: Simulator,
    hyperparameters: Traced,
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
    for one in jax.random.split(key, static.env_steps_per_update):
        for_action, for_step, for_reset = jax.random.split(one, 3)
        q = learnt.network(observation)
        action = jax.random.categorical(for_action, q / hyperparameters.temperature)
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
    static: StaticConfig,
    hyperparameters: Sequence[Hyperparameters],
    datasets: Sequence[Transitions],
    simulator: Simulator | None,
    collects: bool,
) -> None:
    """Refuse runs whose settings, data and world don't fit together, before any work is done.

    Args:
        static: Shared by all runs.
        hyperparameters: One entry for each run.
        datasets: Sets of demonstrations.
        simulator: The world, if there is one.
        collects: Whether experience comes from outside JAX.

    Raises:
        UserError: The line says what doesn't fit.
    """
    if not hyperparameters:
        raise UserError("no runs: pass at least one set of numbers")
    if not datasets:
        raise UserError("no demonstrations: pass at least one set")
    if max(one.dataset for one in hyperparameters) >= len(datasets):
        raise UserError(f"a run names a set of demonstrations beyond the {len(datasets)} given")
    if static.online and simulator is None and not collects:
        raise UserError("online training needs a world: name one, or train offline")
    if static.prior != "none":
        for data in datasets:  # raises where returns aren't known
            data.returns(static.target_kind, static.social_discount)
    if not static.online and (simulator is not None or collects):
        raise UserError("offline training takes no world: drop it, or train online")
    if simulator is not None:
        wanted = (simulator.n_features, simulator.n_actions)
        given = (datasets[0].observation.shape[1], datasets[0].n_actions)
        if wanted != given:
            raise UserError(
                f"the demonstrations have {given[0]} features and {given[1]} actions, "
                f"the world has {wanted[0]} and {wanted[1]}: they belong to another world"
            )
