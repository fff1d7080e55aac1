"""Conservative Q-learning on the relabelled reward λ R(α): offline, from the same demonstrations.

CQL(H) of Kumar et al. 2020 with the soft value of Eq 2.5 in place of the hard maximum, so that it
has the temperature of the learner it stands beside: at `conservatism` = 1 / (2 κ) it is offline
IQ-Learn with the social prior, gradient by gradient (docs/theory.md).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
from jax.tree_util import Partial
from jaxtyping import Array, Float

from socialiq.errors import UserError, one_of
from socialiq.learners import loop
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.expert_table import Batch, ExpertTable
from socialiq.learners.iq_learn import losses
from socialiq.learners.iq_learn.config import Endings
from socialiq.learners.ranges import (
    check_above_zero,
    check_counts,
    check_discount,
    check_not_negative,
    check_rate,
    check_seed,
)
from socialiq.learners.state import History
from socialiq.nn.q_network import ACTIVATIONS, QNetwork, network_of
from socialiq.nn.q_policy import QPolicy
from socialiq.nn.view import CHOICES
from socialiq.social.angle import check_angle, exact_weights, score
from socialiq.types import RewardPair, Transitions

Scalar = Float[Array, ""]

_ADAM = optax.scale_by_adam()


@dataclass(frozen=True)
class StaticConfig:
    """What shapes the program. Defaults: those of IQ-Learn (Table C.1, gridworld)."""

    endings: Endings = field(default_factory=Endings)
    """What V(s') is after each kind of ending."""
    hidden: tuple[int, ...] = (64, 64)
    activation: str = "relu"
    view: str = "flat"
    batch_size: int = 64
    updates: int = 6000

    def __post_init__(self) -> None:
        """Refuse names and sizes that make no run."""
        one_of("activation", self.activation, tuple(ACTIVATIONS))
        one_of("view", self.view, tuple(CHOICES))
        check_counts(self, ("batch_size", "updates"))


@dataclass(frozen=True)
class Hyperparameters:
    """Numbers of one run, all traced."""

    angle: float = 0.0
    """α of the reward, in degrees."""
    strength: float = 1.0
    """λ: the reward is λ R(α)."""
    conservatism: float = 1.0
    """α_CQL, the weight of τ logsumexp(Q/τ) - Q(s, a) beside half the squared error."""
    temperature: float = 1.0
    """τ."""
    discount: float = 0.99
    """γ."""
    learning_rate: float = 3e-4
    polyak: float = 0.005
    """Share of the network mixed into its target network at each update."""
    seed: int = 0
    dataset: int = 0

    def __post_init__(self) -> None:
        """Refuse numbers outside their range, NaN among them."""
        check_angle(self.angle)
        check_not_negative(self, ("strength", "conservatism", "dataset"))
        check_above_zero(self, ("temperature", "learning_rate"))
        check_discount(self.discount)
        check_rate(self, ("polyak",))
        check_seed(self.seed)


class Traced(NamedTuple):
    """`Hyperparameters` as arrays, with the angle's weights in place of the angle."""

    weights: RewardPair
    strength: Array
    conservatism: Array
    temperature: Array
    discount: Array
    learning_rate: Array
    polyak: Array
    seed: Array
    dataset: Array


class _Learnt(NamedTuple):
    network: QNetwork
    target_network: QNetwork
    adam: Any


@dataclass(frozen=True)
class Trained:
    """The outcome: one network for each of `numbers`; `failures` has a line for each that broke."""

    static: StaticConfig
    hyperparameters: tuple[Hyperparameters, ...]
    networks: QNetwork
    history: History
    failures: tuple[str, ...]

    def policy(self, run: int) -> QPolicy:
        """The trained policy of one run."""
        record = {
            "learner": "cql",
            "structure": dataclasses.asdict(self.static),
            "numbers": dataclasses.asdict(self.hyperparameters[run]),
        }
        temperature = self.hyperparameters[run].temperature
        return QPolicy.of(network_of(self.networks, run), temperature, record)


def train(
    static: StaticConfig,
    hyperparameters: Sequence[Hyperparameters],
    datasets: Sequence[Transitions],
    callbacks: Callbacks | None = None,
    chunk: int = 500,
) -> Trained:
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
    table = ExpertTable.of(datasets, "instantaneous", 0.0)
    sizes = (datasets[0].observation.shape[1], datasets[0].n_actions)
    callbacks = callbacks or Callbacks()
    names = callbacks.run_names or tuple(
        f"angle {n.angle:g}, seed {n.seed}" for n in hyperparameters
    )
    update = Partial(partial(_update, static), table)
    runs, history = loop.run(
        initialise=partial(_initialise, static, sizes),
        update=update,
        hyperparameters=traced(hyperparameters),
        total=static.updates,
        chunk=chunk,
        fingerprint=loop.fingerprint(table, static, *hyperparameters, chunk),
        callbacks=dataclasses.replace(callbacks, run_names=names),
    )
    terms = loop.term_names(update, traced(hyperparameters), runs)
    failures = loop.failure_lines(runs, terms, names)
    return Trained(static, tuple(hyperparameters), runs.learnt.network, history, failures)


def traced(hyperparameters: Sequence[Hyperparameters]) -> Traced:
    """Stack the hyperparameters of the runs into arrays."""
    pairs = [exact_weights(one.angle) for one in hyperparameters]
    kinds: dict[str, Any] = {"seed": jnp.uint32, "dataset": jnp.int32}
    columns = {
        name: jnp.array(
            [getattr(one, name) for one in hyperparameters], kinds.get(name, jnp.float32)
        )
        for name in Traced._fields
        if name != "weights"
    }
    env, social = (jnp.array(column, jnp.float32) for column in zip(*pairs, strict=True))
    return Traced(RewardPair(env, social), **columns)


def conservative_loss(
    network: QNetwork,
    target_network: QNetwork,
    batch: Batch,
    hyperparameters: Traced,
    static: StaticConfig,
) -> tuple[Scalar, dict[str, Scalar]]:
    """1/2 E[(Q(s, a) - λ R(α) - γ (1 - d) V(s'))²] + α_CQL E[V(s) - Q(s, a)], and its terms.

    V(s) = τ log sum_a exp(Q(s, a) / τ); V(s') is that of the target network, without gradient.
    Kumar et al. 2020, their Eq 4, with both expectations over the demonstrations.
    """
    q = jax.vmap(network)(batch.observation)
    taken = jnp.take_along_axis(q, batch.action[:, None], axis=1)[:, 0]
    q_next = jax.vmap(target_network)(batch.next_observation)
    follows = losses.continuation(
        losses.soft_value(q_next, hyperparameters.temperature),
        batch.ending,
        static.endings.by_kind(),
        losses.absorbing_value(q.shape[-1], hyperparameters.temperature, hyperparameters.discount),
    )
    reward = hyperparameters.strength * score(hyperparameters.weights, batch.target)
    error = losses.implicit_reward(taken, follows, hyperparameters.discount) - reward
    gap = jnp.mean(losses.soft_value(q, hyperparameters.temperature) - taken)
    terms = {
        "bellman": jnp.mean(jnp.square(error)) / 2,
        "conservative": hyperparameters.conservatism * gap,
    }
    total = terms["bellman"] + terms["conservative"]
    return total, terms | {"max_q": jnp.max(jnp.abs(q)), "loss": total}


def _initialise(
    static: StaticConfig, sizes: tuple[int, int], hyperparameters: Traced
) -> tuple[_Learnt, Array]:
    key, for_network = jax.random.split(jax.random.key(hyperparameters.seed))
    n_features, n_actions = sizes
    network = QNetwork.initialise(
        for_network, n_features, static.hidden, n_actions, static.activation, static.view
    )
    return _Learnt(network, network, _ADAM.init(eqx.filter(network, eqx.is_array))), key


def _update(
    static: StaticConfig, table: ExpertTable, hyperparameters: Traced, learnt: _Learnt, key: Array
) -> tuple[_Learnt, Array, dict[str, Array]]:
    """Sample, and take one Adam step on the loss."""
    key, for_batch = jax.random.split(key)
    batch = table.sample(for_batch, hyperparameters.dataset, static.batch_size)
    gradient, terms = jax.grad(conservative_loss, has_aux=True)(
        learnt.network, learnt.target_network, batch, hyperparameters, static
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
    return _Learnt(network, target_network, adam), key, terms
