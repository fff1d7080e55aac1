"""The part that learners with an actor and critics share: networks, rows, acting, equations.

The equations of soft actor-critic (Haarnoja et al. 2018) are one function each, of a policy
π = squashed Gaussian and twin critics Q_1, Q_2; the score R(α) is the reward.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq.learners import replay
from socialiq.learners.continuous import acting
from socialiq.learners.continuous.acting import Acting
from socialiq.learners.dial.rows import draw_directions
from socialiq.learners.expert_table import Batch, ExpertTable
from socialiq.learners.iq_learn import losses
from socialiq.learners.kernel import Learner, Terms
from socialiq.learners.state import HyperparameterArrays, TrainState
from socialiq.nn.actor import Actor, TwinCritics, draw, frozen
from socialiq.nn.actor_policy import ActorDial, ActorPolicy
from socialiq.nn.dial_policy import angle_columns
from socialiq.types import ContinuousSimulator, Ending, RewardPair, Transitions

Scalar = Float[Array, ""]


class Networks(NamedTuple):
    """Networks that an optimiser step changes.

    Attributes:
        actor: The policy.
        critics: Its values.
        log_temperature: log τ, which only a tuned temperature changes.
    """

    actor: Actor
    critics: TwinCritics
    log_temperature: Scalar


class Carry(NamedTuple):
    """Loop carry of an update.

    Attributes:
        key: Random key.
        replay: The learner's own transitions; None offline.
        acting: Where it acts; None offline, or if experience comes from outside JAX.
        more: What a learner adds.
    """

    key: Array
    replay: replay.Replay | None
    acting: Acting | None
    more: Any = None


class Rows(NamedTuple):
    """Rows of one update.

    Attributes:
        batch: Transitions, demonstrations first.
        direction: (cos α, sin α) of each row.
        n_expert: How many are demonstrations.
        key: For the actions that the loss draws.
        initial: Observations of true initial states; None if they have no use.
        more: What a learner adds.
    """

    batch: Batch
    direction: RewardPair
    n_expert: int
    key: PRNGKeyArray
    initial: Float[Array, "batch feature"] | None = None
    more: Any = None


class ActorCritic(Learner):
    """Base of learners with an actor and twin critics; a subclass writes `loss`.

    `sizes` are the length of an observation and of an action.

    Attributes:
        simulator: The world to act in; None offline, or when experience is collected outside JAX.
    """

    simulator: ContinuousSimulator | None = eqx.field(static=True, default=None)

    stochastic: ClassVar[bool] = True
    """Whether the actor has deviations."""
    online: ClassVar[bool] = True
    """Whether the learner keeps a replay."""
    shown: ClassVar[bool] = False
    """Whether the learner sees demonstrations."""

    @classmethod
    def of(
        cls,
        static: Any,
        datasets: Sequence[Transitions],
        simulator: ContinuousSimulator | None = None,
    ) -> Any:
        """Make the learner of sets of demonstrations and the world to act in.

        Raises:
            UserError: If there is none, or they differ in features or actions, or these are
                discrete.
        """
        table = ExpertTable.of(datasets, cls.target_kind, 1.0, continuous=True)
        sizes = (int(datasets[0].observation.shape[1]), int(datasets[0].action.shape[1]))
        return cls(static, sizes, table, simulator)

    @property
    def keeps_replay(self) -> bool:
        """Whether this run has own transitions."""
        return self.online

    def network(self, key: PRNGKeyArray) -> Networks:
        """Draw an actor and critics."""
        static, (n_features, size) = self.static, self.sizes
        extra = 2 if static.dial else 0  # (cos α, sin α)
        for_actor, for_critics = jax.random.split(key)
        shape = (n_features + extra, static.hidden, size, static.activation, static.input_scale)
        seen: dict[str, Any] = {"view": static.view, "times": static.times, "extra": extra}
        actor = Actor.initialise(for_actor, *shape, stochastic=self.stochastic, **seen)
        critics = TwinCritics.initialise(for_critics, *shape, **seen)
        return Networks(actor, critics, jnp.zeros(()))

    def initialise(self, hyperparameters: HyperparameterArrays) -> tuple[TrainState, Carry]:
        """Draw networks and start an episode, from the run's seed alone."""
        key, for_network, for_acting = jax.random.split(jax.random.key(hyperparameters.seed), 3)
        network = self.network(for_network)
        if hasattr(hyperparameters, "temperature"):
            first = jnp.log(hyperparameters.temperature)
            network = network._replace(log_temperature=first)
        ring = None
        if self.keeps_replay:
            ring = replay.empty_of(self.static.replay_capacity, empty_row(self.sizes))
        begun = None
        if self.simulator is not None:
            begun = acting.begin(self.simulator, self.static, hyperparameters, for_acting)
        return self.first_state(network), Carry(key, ring, begun)

    def draw(
        self, hyperparameters: HyperparameterArrays, state: TrainState, carry: Carry
    ) -> tuple[Rows, Carry]:
        """Act in the world, if there is one, and sample the rows of an update."""
        static = self.static
        keys = jax.random.split(carry.key, 6)
        carry = carry._replace(key=keys[0])
        if self.simulator is not None:
            ring, now = carry.replay, carry.acting
            assert ring is not None and now is not None  # such a learner keeps a replay
            acting_inputs = (
                self.simulator,
                static,
                hyperparameters,
                state.network.actor,
                ring,
                now,
            )
            ring, now = acting.act(*acting_inputs, keys[1])
            carry = carry._replace(replay=ring, acting=now)
        batches = []
        if self.shown:
            assert self.table is not None
            batches.append(self.demonstrated(keys[2], hyperparameters, carry))
        if carry.replay is not None:
            batches.append(replay.sample(carry.replay, keys[3], static.batch_size))
        batch = jax.tree.map(lambda *columns: jnp.concatenate(columns), *batches)
        count, n_expert = len(batch.ending), static.batch_size if self.shown else 0
        direction = jax.tree.map(
            lambda weight: jnp.broadcast_to(weight, (count,)), hyperparameters.weights
        )
        if static.dial:
            direction = draw_directions(keys[4], count, static)
        return Rows(batch, direction, n_expert, keys[5]), carry

    def demonstrated(
        self,
        key: PRNGKeyArray,
        hyperparameters: HyperparameterArrays,
        carry: Carry,  # noqa: ARG002
    ) -> Batch:
        """Return demonstrations, all alike."""
        assert self.table is not None
        return self.table.sample(key, hyperparameters.dataset, self.static.batch_size)

    def seen(
        self, observation: Float[Array, "batch feature"], direction: RewardPair
    ) -> Float[Array, "batch input"]:
        """Return the networks' inputs: observations, and of a dial the angles."""
        if not self.static.dial:
            return observation
        return jnp.concatenate([observation, *angle_columns(direction, ())], axis=-1)

    def learning_rate(self, hyperparameters: HyperparameterArrays, done: Array) -> Any:
        """Return the learning rates of actor, critics and temperature, as `Networks` of scalars."""
        rate: Any = super().learning_rate(hyperparameters, done)
        share = getattr(hyperparameters, "actor_rate", 1.0)
        return Networks(rate * share, rate, rate)

    def temperature(self, network: Networks, hyperparameters: HyperparameterArrays) -> Scalar:
        """Return τ, without gradient."""
        if not self.static.tuned:
            return hyperparameters.temperature
        return jax.lax.stop_gradient(jnp.exp(network.log_temperature))

    def continued(
        self,
        value: Float[Array, " batch"],
        batch: Batch,
        temperature: Scalar,
        hyperparameters: HyperparameterArrays,
        occupancy: Float[Array, " kind"] | None = None,
    ) -> Float[Array, " batch"]:
        """(1 - d) V(s') of Eq 2.6; an absorbing state has the entropy of uniform actions."""
        volume = 2 ** self.sizes[1]
        absorbing = losses.absorbing_value(volume, temperature, hyperparameters.discount)
        treatment = self.static.endings.by_kind()
        return losses.continuation(value, batch.ending, treatment, absorbing, occupancy)

    def improvement(
        self,
        network: Networks,
        seen: Float[Array, "batch input"],
        key: PRNGKeyArray,
        hyperparameters: HyperparameterArrays,
    ) -> Terms:
        """Return the losses of the actor and of a tuned temperature, and the entropy."""
        temperature = self.temperature(network, hyperparameters)
        sampled = draw_actions(network.actor, seen, key, self.static.actions_per_state)
        q = drawn_values(frozen(network.critics), seen, sampled).min(axis=-1)
        terms = {"actor": actor_loss(q, sampled, temperature)}
        if self.static.tuned:
            entropy = hyperparameters.entropy_target * self.sizes[1]
            terms["tuning"] = temperature_loss(network.log_temperature, sampled, entropy)
        return terms | {"entropy": -jnp.mean(sampled.log_density)}

    def policy(
        self,
        hyperparameters: Any,
        state: TrainState,
        kept: Any = None,  # noqa: ARG002
    ) -> ActorPolicy | ActorDial:
        """Return the trained actor of one run, or its dial."""
        policy = ActorPolicy.of(state.network.actor, self.record(hyperparameters))
        static = self.static
        return ActorDial(policy, static.low, static.high) if static.dial else policy

    def run_name(self, hyperparameters: Any) -> str:
        """Return the name of a run in messages."""
        if self.static.dial:
            return f"dial, seed {hyperparameters.seed}"
        return super().run_name(hyperparameters)


def empty_row(sizes: tuple[int, int]) -> Batch:
    """Return a transition of zeros, with the shapes and types of a replay's rows."""
    observation, zero = jnp.zeros(sizes[0]), jnp.zeros(())
    action, ending = jnp.zeros(sizes[1]), jnp.array(int(Ending.NONE), jnp.int32)
    return Batch(observation, action, observation, ending, RewardPair(zero, zero))


class Drawn(NamedTuple):
    """Actions that a policy draws in each state.

    Attributes:
        action: Several for each state.
        log_density: log π of each.
    """

    action: Float[Array, "draw batch size"]
    log_density: Float[Array, "draw batch"]


def draw_actions(
    actor: Actor, seen: Float[Array, "batch input"], key: PRNGKeyArray, count: int
) -> Drawn:
    """Draw so many actions in each state, with gradients to the actor."""
    mean, log_std = jax.vmap(actor)(seen)
    noise = jax.random.normal(key, (count, *mean.shape))
    of_rows = jax.vmap(draw)
    return Drawn(*jax.vmap(of_rows, in_axes=(0, None, None))(noise, mean, log_std))


def drawn_values(
    critics: TwinCritics, seen: Float[Array, "batch input"], drawn: Drawn
) -> Float[Array, "draw batch 2"]:
    """Q_1 and Q_2 of drawn actions."""
    return jax.vmap(jax.vmap(critics), in_axes=(None, 0))(seen, drawn.action)


def soft_value(
    q: Float[Array, "draw batch"], drawn: Drawn, temperature: Scalar | float
) -> Float[Array, " batch"]:
    """V(s) = E_π[Q(s, a) - τ log π(a|s)], the mean over the drawn actions.

    At π = exp(Q/τ) / ∫ exp(Q/τ) it is τ log ∫ exp(Q/τ) da, Eq 2.5 with an integral for the sum.
    """
    return jnp.mean(q - temperature * drawn.log_density, axis=0)


def critic_loss(q: Float[Array, "batch 2"], target: Float[Array, " batch"]) -> Scalar:
    """Σ_i E[(Q_i(s, a) - y)²] / 2."""
    return jnp.mean(jnp.sum(jnp.square(q - target[:, None]), axis=-1)) / 2.0


def actor_loss(q: Float[Array, "draw batch"], drawn: Drawn, temperature: Scalar | float) -> Scalar:
    """E[τ log π(a|s) - Q(s, a)] of drawn actions, whose gradient runs through the action."""
    return -jnp.mean(soft_value(q, drawn, temperature))


def temperature_loss(log_temperature: Scalar, drawn: Drawn, entropy: Any) -> Scalar:
    """-log τ E[log π + H]: τ rises while the policy's entropy is below H, and falls above it."""
    gap = jax.lax.stop_gradient(jnp.mean(drawn.log_density) + entropy)
    return -log_temperature * gap
