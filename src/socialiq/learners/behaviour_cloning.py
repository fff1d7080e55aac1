"""Behaviour cloning: the maximum-likelihood classifier of actions, on the same data and network.

Of all demonstrations alike, or weighted by how well they score at an angle: there Eq B.2 is taken
with each episode's undiscounted total as its score. Every transition has the weight of its
episode, so that at a high τ_w the clone is the plain one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
from jax.tree_util import Partial
from jaxtyping import Array

from socialiq.errors import UserError, one_of
from socialiq.learners import loop
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.expert_table import ExpertTable
from socialiq.learners.iq_learn import priors
from socialiq.learners.ranges import check_above_zero, check_counts, check_not_negative, check_seed
from socialiq.learners.state import History
from socialiq.nn.q_network import ACTIVATIONS, QNetwork, network_of
from socialiq.nn.q_policy import QPolicy
from socialiq.nn.view import CHOICES
from socialiq.social.angle import check_angle, exact_weights
from socialiq.types import RewardPair, Transitions

_ADAM = optax.scale_by_adam()


@dataclass(frozen=True)
class StaticConfig:
    """What shapes the program."""

    hidden: tuple[int, ...] = (64, 64)
    activation: str = "relu"
    batch_size: int = 64
    updates: int = 6000
    weighted: bool = False
    """Whether demonstrations count by their score, or all alike."""
    view: str = "flat"
    """How the network sees the vehicles of the intersection; a name of `nn.view.CHOICES`."""

    def __post_init__(self) -> None:
        """Refuse names and sizes that make no run."""
        one_of("activation", self.activation, tuple(ACTIVATIONS))
        one_of("view", self.view, tuple(CHOICES))
        check_counts(self, ("batch_size", "updates"))


@dataclass(frozen=True)
class Hyperparameters:
    """Numbers of one run, all traced."""

    learning_rate: float = 3e-4
    seed: int = 0
    dataset: int = 0
    angle: float = 0.0
    """α of the score, in degrees; only of weighted runs."""
    reweight_temperature: float = 1.0
    """τ_w of Eq B.2, in units of an episode's total; only of weighted runs."""

    def __post_init__(self) -> None:
        """Refuse numbers outside their range, NaN among them."""
        check_angle(self.angle)
        check_above_zero(self, ("learning_rate", "reweight_temperature"))
        check_seed(self.seed)
        check_not_negative(self, ("dataset",))


class _Traced(NamedTuple):
    learning_rate: Array
    seed: Array
    dataset: Array
    weights: RewardPair
    reweight_temperature: Array


class _Learnt(NamedTuple):
    network: QNetwork
    adam: Any


class _Surroundings(NamedTuple):
    """A random key, and the cumulative weights of Eq B.2; None where all rows count alike."""

    key: Array
    cumulative: Array | None


@dataclass(frozen=True)
class Cloned:
    """The outcome: one network for each of `numbers`."""

    static: StaticConfig
    hyperparameters: tuple[Hyperparameters, ...]
    networks: QNetwork
    history: History

    def policy(self, run: int) -> QPolicy:
        """The clone of one run; its soft policy at τ = 1 is the fitted distribution."""
        record = {
            "learner": "behaviour_cloning",
            "structure": asdict(self.static),
            "numbers": asdict(self.hyperparameters[run]),
        }
        return QPolicy.of(network_of(self.networks, run), 1.0, record)


def clone(
    static: StaticConfig,
    hyperparameters: Sequence[Hyperparameters],
    datasets: Sequence[Transitions],
    callbacks: Callbacks | None = None,
    chunk: int = 500,
) -> Cloned:
    """Train one run for each entry of `hyperparameters`, all in one compiled program.

    Args:
        static: Shared by all runs.
        hyperparameters: One entry for each run.
        datasets: Sets of demonstrations; `Hyperparameters.dataset` picks each run's.
        callbacks: Progress, monitor, checkpoint.
        chunk: Updates between two looks at the outside.

    Raises:
        UserError: If there is no run, or no such set of demonstrations.
        Stopped: On Ctrl-C.
    """
    if not hyperparameters or max(one.dataset for one in hyperparameters) >= len(datasets):
        raise UserError("pass at least one run, and the demonstrations that each run names")
    table = _table(static, datasets)
    sizes = (datasets[0].observation.shape[1], datasets[0].n_actions)
    runs, history = loop.run(
        initialise=Partial(partial(_initialise, static, sizes), table),
        update=Partial(partial(_update, static), table),
        hyperparameters=_traced(hyperparameters),
        total=static.updates,
        chunk=chunk,
        fingerprint=loop.fingerprint(table, static, *hyperparameters),
        callbacks=callbacks or Callbacks(),
    )
    return Cloned(static, tuple(hyperparameters), runs.learnt.network, history)


def effective_size(data: Transitions, hyperparameters: Hyperparameters) -> float:
    """How many transitions of equal weight a weighted run's demonstrations are worth (B.2)."""
    weights = jax.tree.map(lambda column: column[0], _traced([hyperparameters])).weights
    table = _table(StaticConfig(weighted=True), [data])
    temperature = hyperparameters.reweight_temperature
    found = priors.table_weights(table, weights, jnp.array(0), temperature)
    return float(priors.effective_sample_size(found))


def _table(static: StaticConfig, datasets: Sequence[Transitions]) -> ExpertTable:
    """The sets; where they are weighted, with each episode's total on all its rows."""
    if static.weighted:
        return ExpertTable.of(datasets, "trajectory", 1.0)
    return ExpertTable.of(datasets, "instantaneous", 0.0)


def _traced(hyperparameters: Sequence[Hyperparameters]) -> _Traced:
    env, social = zip(*(exact_weights(one.angle) for one in hyperparameters), strict=True)
    return _Traced(
        jnp.array([one.learning_rate for one in hyperparameters], jnp.float32),
        jnp.array([one.seed for one in hyperparameters], jnp.uint32),
        jnp.array([one.dataset for one in hyperparameters], jnp.int32),
        RewardPair(jnp.array(env, jnp.float32), jnp.array(social, jnp.float32)),
        jnp.array([one.reweight_temperature for one in hyperparameters], jnp.float32),
    )


def negative_log_likelihood(network: QNetwork, observation: Array, action: Array) -> Array:
    """-E[log softmax(network(s))[a]]."""
    logits = jax.vmap(network)(observation)
    return optax.softmax_cross_entropy_with_integer_labels(logits, action).mean()


def _initialise(
    static: StaticConfig, sizes: tuple[int, int], table: ExpertTable, hyperparameters: _Traced
) -> tuple[_Learnt, _Surroundings]:
    key, for_network = jax.random.split(jax.random.key(hyperparameters.seed))
    network = QNetwork.initialise(
        for_network, sizes[0], static.hidden, sizes[1], static.activation, static.view
    )
    cumulative = None
    if static.weighted:
        found = priors.table_weights(
            table,
            hyperparameters.weights,
            hyperparameters.dataset,
            hyperparameters.reweight_temperature,
        )
        cumulative = jnp.cumsum(found)
    adam = _ADAM.init(eqx.filter(network, eqx.is_array))
    return _Learnt(network, adam), _Surroundings(key, cumulative)


def _update(
    static: StaticConfig,
    table: ExpertTable,
    hyperparameters: _Traced,
    learnt: _Learnt,
    surroundings: _Surroundings,
) -> tuple[_Learnt, _Surroundings, dict[str, Array]]:
    key, for_batch = jax.random.split(surroundings.key)
    if surroundings.cumulative is not None:
        batch = table.sample_weighted(for_batch, surroundings.cumulative, static.batch_size)
    else:
        batch = table.sample(for_batch, hyperparameters.dataset, static.batch_size)
    loss, gradient = jax.value_and_grad(negative_log_likelihood)(
        learnt.network, batch.observation, batch.action
    )
    direction, adam = _ADAM.update(gradient, learnt.adam)
    network = jax.tree.map(
        lambda weight, step: weight - hyperparameters.learning_rate * step,
        learnt.network,
        direction,
    )
    return _Learnt(network, adam), surroundings._replace(key=key), {"loss": loss}
