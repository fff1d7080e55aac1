"""The part that learners with an actor and critics share: networks, rows, acting, equations.

The equations are those of soft actor-critic (Haarnoja et al. 2018), for a policy π = squashed
Gaussian and twin critics Q_1, Q_2; the score R(α) is the reward.
"""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq.learners.dial.rows import Acting, draw_directions
from socialiq.learners.expert_table import Batch, Replay
from socialiq.learners.kernel import Learner, Terms
from socialiq.learners.state import HyperparameterArrays, TrainState
from socialiq.nn.actor import Actor, TwinCritics, draw, frozen
from socialiq.nn.actor_policy import ActorDial, ActorPolicy
from socialiq.nn.view import angle_columns
from socialiq.types import ContinuousSimulator, Ending, RewardPair

Scalar = Float[Array, ""]


class Networks(NamedTuple):
    """Networks that an optimiser step changes, and log τ, which only a tuned temperature does."""

    actor: Actor
    critics: TwinCritics
    log_temperature: Scalar


class Carry(NamedTuple):
    """Loop carry of an update: own transitions, the place in a compiled world, a learner's own."""

    key: Array
    replay: Replay | None
    acting: Acting | None
    more: Any = None


class Rows(NamedTuple):
    """Rows of one update, `n_expert` demonstrations first, and a key for actions of the loss.

    Attributes:
        direction: (cos α, sin α) of each row.
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

    @property
    def volume(self) -> int:
        """Volume of all actions: uniform ones have the entropy of its logarithm."""
        return 2 ** self.sizes[1]

    @property
    def keeps_replay(self) -> bool:
        """Whether this run has own transitions."""
        return self.online

    def network(self, key: PRNGKeyArray) -> Networks:
        """Draw an actor and critics."""
        static = self.static
        n_features, size = self.sizes
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
        ring = begun = None
        if self.keeps_replay:
            ring = Replay.empty(self.static.replay_capacity, Batch.empty(*self.sizes))
        if self.simulator is not None:
            begun = self.begin(hyperparameters, for_acting)
        return self.first_state(network), Carry(key, ring, begun)

    def begin(self, hyperparameters: HyperparameterArrays, key: PRNGKeyArray) -> Acting:
        """Start an episode, of a dial at a drawn angle.

        Args:
            hyperparameters: Numbers of one run, with the weights of its angle.
            key: Random key.

        Returns:
            The first state of the episode, and its direction (cos α, sin α), scalars.
        """
        assert self.simulator is not None
        for_world, for_angle = jax.random.split(key)
        direction = hyperparameters.weights
        if self.static.dial:
            direction = jax.tree.map(jnp.squeeze, draw_directions(for_angle, 1, self.static))
        return Acting(*self.simulator.reset(for_world), direction)

    def act(
        self, hyperparameters: HyperparameterArrays, actor: Actor, carry: Carry, key: PRNGKeyArray
    ) -> Carry:
        """Take `env_steps_per_update` steps with drawn actions, the first of a run uniform.

        Args:
            hyperparameters: Numbers of one run.
            actor: The actor that draws.
            carry: Carry of the run.
            key: Random key.

        Returns:
            The carry with the new transitions in its replay, and the new place in the world.
        """
        ring = carry.replay
        now = carry.acting
        assert self.simulator and ring and now  # such a learner keeps a replay
        for step_key in jax.random.split(key, self.static.env_steps_per_update):
            for_action, for_random, for_step, for_reset = jax.random.split(step_key, 4)
            mean, log_std = actor(self.inputs(now.observation, now.direction))
            sampled = jnp.tanh(mean + jnp.exp(log_std) * jax.random.normal(for_action, mean.shape))
            uniform = jax.random.uniform(for_random, mean.shape, minval=-1.0, maxval=1.0)
            action = jnp.where(ring.added < self.static.random_steps, uniform, sampled)
            follows, step = self.simulator.advance(for_step, now.episode, action)
            row = Batch(now.observation, action, step.observation, step.ending, step.rewards)
            ring = ring.add(row)
            ended = step.ending != int(Ending.NONE)
            fresh = self.begin(hyperparameters, for_reset)
            going = Acting(follows, step.observation, now.direction)
            now = jax.tree.map(
                lambda new, old, ended=ended: jnp.where(ended, new, old), fresh, going
            )
        return carry._replace(replay=ring, acting=now)

    def draw(
        self, hyperparameters: HyperparameterArrays, state: TrainState, carry: Carry
    ) -> tuple[Rows, Carry]:
        """Act in the world, if there is one, and sample the rows of an update.

        Args:
            hyperparameters: Numbers of one run.
            state: State of the run, with the actor that acts.
            carry: Carry of the run.

        Returns:
            The rows, demonstrations first, and the carry with the next key.
        """
        static = self.static
        keys = jax.random.split(carry.key, 6)
        carry = carry._replace(key=keys[0])
        if self.simulator is not None:
            carry = self.act(hyperparameters, state.network.actor, carry, keys[1])
        batches = []
        if self.shown:
            assert self.table is not None
            batches.append(self.demonstrated(keys[2], hyperparameters, carry))
        if carry.replay is not None:
            batches.append(carry.replay.sample(keys[3], static.batch_size))
        batch = jax.tree.map(lambda *columns: jnp.concatenate(columns), *batches)
        count = len(batch.ending)
        n_expert = static.batch_size if self.shown else 0
        direction = jax.tree.map(
            lambda weight: jnp.broadcast_to(weight, (count,)), hyperparameters.weights
        )
        if static.dial:
            direction = draw_directions(keys[4], count, static)
        return Rows(batch, direction, n_expert, keys[5]), carry

    def demonstrated(
        self, key: PRNGKeyArray, hyperparameters: HyperparameterArrays, _carry: Carry, /
    ) -> Batch:
        """Return demonstrations, all alike.

        Args:
            key: Random key.
            hyperparameters: Numbers of one run; `dataset` is the index of the set.

        Returns:
            A batch of `batch_size` demonstrations.
        """
        assert self.table is not None
        return self.table.sample(key, hyperparameters.dataset, self.static.batch_size)

    def inputs(
        self, observation: Float[Array, "*batch feature"], direction: RewardPair
    ) -> Float[Array, "*batch input"]:
        """Return the networks' inputs: observations, and of a dial the angles.

        Args:
            observation: Observations, (..., feature).
            direction: (cos α, sin α) of each observation; only of a dial.

        Returns:
            The inputs, (..., input).
        """
        if not self.static.dial:
            return observation
        return jnp.concatenate([observation, *angle_columns(direction, ())], axis=-1)

    def learning_rate(self, hyperparameters: HyperparameterArrays, done: Array) -> Any:
        """Return the learning rates of actor, critics and temperature, as `Networks` of scalars.

        Args:
            hyperparameters: Numbers of one run; `actor_rate`, if it has one, is the actor's share
                of the rate.
            done: Number of updates done.

        Returns:
            The rates.
        """
        rate: Any = super().learning_rate(hyperparameters, done)
        share = getattr(hyperparameters, "actor_rate", 1.0)
        return Networks(rate * share, rate, rate)

    def temperature(self, network: Networks, hyperparameters: HyperparameterArrays) -> Scalar:
        """Return τ, without gradient.

        Args:
            network: Networks with log τ, which is read if the temperature is tuned.
            hyperparameters: Numbers of one run, with the given temperature.

        Returns:
            τ, in units of reward.
        """
        if not self.static.tuned:
            return hyperparameters.temperature
        return jax.lax.stop_gradient(jnp.exp(network.log_temperature))

    def improvement(
        self,
        network: Networks,
        inputs: Float[Array, "batch input"],
        key: PRNGKeyArray,
        hyperparameters: HyperparameterArrays,
    ) -> Terms:
        """Return the losses of the actor and of a tuned temperature, and the entropy.

        Args:
            network: Networks; the critics get no gradient.
            inputs: Inputs of the networks, (batch, input).
            key: Random key of the drawn actions.
            hyperparameters: Numbers of one run.

        Returns:
            The terms "actor", "tuning" if the temperature is tuned, and "entropy", which is
            recorded only, in nats.
        """
        temperature = self.temperature(network, hyperparameters)
        sampled = draw_actions(network.actor, inputs, key, self.static.actions_per_state)
        q = drawn_values(frozen(network.critics), inputs, sampled).min(axis=-1)
        terms = {"actor": actor_loss(q, sampled, temperature)}
        if self.static.tuned:
            entropy = hyperparameters.entropy_target * self.sizes[1]
            terms["tuning"] = temperature_loss(network.log_temperature, sampled, entropy)
        return terms | {"entropy": -jnp.mean(sampled.log_density)}

    def policy(
        self, hyperparameters: Any, state: TrainState, _retained: Any = None
    ) -> ActorPolicy | ActorDial:
        """Return the trained actor of one run, or its dial.

        Args:
            hyperparameters: Numbers of the run, for the record.
            state: State of the run.

        Returns:
            The policy of the run's angle, or the dial of all trained angles.
        """
        policy = ActorPolicy.of(state.network.actor, self.record(hyperparameters))
        static = self.static
        return ActorDial(policy, static.low, static.high) if static.dial else policy

    def run_name(self, hyperparameters: Any) -> str:
        """Return the name of a run in messages."""
        if self.static.dial:
            return f"dial, seed {hyperparameters.seed}"
        return super().run_name(hyperparameters)


class Drawn(NamedTuple):
    """Actions that a policy draws in each state, and log π of each."""

    action: Float[Array, "draw batch size"]
    log_density: Float[Array, "draw batch"]


def draw_actions(
    actor: Actor, inputs: Float[Array, "batch input"], key: PRNGKeyArray, count: int
) -> Drawn:
    """Draw `count` actions in each state, with gradients to the actor.

    Args:
        actor: The policy.
        inputs: Inputs of each state, (batch, input).
        key: Random key.
        count: Number of actions in each state.

    Returns:
        The actions, (draw, batch, size), and their log-densities, (draw, batch).
    """
    mean, log_std = jax.vmap(actor)(inputs)
    noise = jax.random.normal(key, (count, *mean.shape))
    of_rows = jax.vmap(draw)
    return Drawn(*jax.vmap(of_rows, in_axes=(0, None, None))(noise, mean, log_std))


def drawn_values(
    critics: TwinCritics, inputs: Float[Array, "batch input"], sampled: Drawn
) -> Float[Array, "draw batch 2"]:
    """Return Q_1 and Q_2 of drawn actions.

    Args:
        critics: The critics.
        inputs: Inputs of each state, (batch, input).
        sampled: Actions drawn in these states.

    Returns:
        The values, (draw, batch, 2).
    """
    return jax.vmap(jax.vmap(critics), in_axes=(None, 0))(inputs, sampled.action)


def soft_value(
    q: Float[Array, "draw batch"], sampled: Drawn, temperature: Scalar | float
) -> Float[Array, " batch"]:
    """Return V(s) = E_π[Q(s, a) - τ log π(a|s)], the mean over the drawn actions.

    At π = exp(Q/τ) / ∫ exp(Q/τ) it is τ log ∫ exp(Q/τ) da, Eq 2.5 with an integral for the sum.

    Args:
        q: Q of each drawn action.
        sampled: The drawn actions.
        temperature: τ, in units of reward.

    Returns:
        V of each state.
    """
    return jnp.mean(q - temperature * sampled.log_density, axis=0)


def critic_loss(q: Float[Array, "batch 2"], target: Float[Array, " batch"]) -> Scalar:
    """Return Σ_i E[(Q_i(s, a) - y)²] / 2.

    Args:
        q: Q_1 and Q_2 of each row.
        target: y of each row.

    Returns:
        The loss of both critics.
    """
    return jnp.mean(jnp.sum(jnp.square(q - target[:, None]), axis=-1)) / 2.0


def actor_loss(
    q: Float[Array, "draw batch"], sampled: Drawn, temperature: Scalar | float
) -> Scalar:
    """Return E[τ log π(a|s) - Q(s, a)] of drawn actions, whose gradient runs through the action.

    Args:
        q: Q of each drawn action.
        sampled: The drawn actions.
        temperature: τ, in units of reward.

    Returns:
        The mean over states and drawn actions.
    """
    return -jnp.mean(soft_value(q, sampled, temperature))


def temperature_loss(log_temperature: Scalar, sampled: Drawn, entropy: Any) -> Scalar:
    """Return -log τ E[log π + H]: τ rises while the policy's entropy is below H, and falls above.

    Args:
        log_temperature: log τ.
        sampled: Drawn actions of the policy.
        entropy: H of a whole action, in nats.

    Returns:
        The loss, with a gradient in log τ alone.
    """
    gap = jax.lax.stop_gradient(jnp.mean(sampled.log_density) + entropy)
    return -log_temperature * gap
