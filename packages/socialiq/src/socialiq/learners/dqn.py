"""Deep Q-learning on R(α): ε-greedy acting outside JAX, and learning in one compiled scan (5.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float, Int

from socialiq.errors import UserError
from socialiq.learners import settings
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.collect import Behaviour, Collector, Source
from socialiq.learners.expert_table import Batch, Carry, Replay
from socialiq.learners.kernel import Learner, Terms, Trained
from socialiq.learners.settings import Count
from socialiq.learners.state import HyperparameterArrays, TrainState
from socialiq.nn.q_network import QNetwork
from socialiq.nn.q_policy import QPolicy
from socialiq.social.angle import score
from socialiq.types import Act, Ending

Loss = Literal["huber", "squared"]


@dataclass(frozen=True, kw_only=True)
class DQNConfig(settings.Network, settings.Replay):
    """Choices that shape the program. Defaults: the experts of thesis 5.2.

    The thesis gives network, learning rate, discount, steps and environments. The rest
    follows Stable-Baselines3's DQN where its default fits, or was chosen here.
    """

    hidden: settings.Widths = (256, 256)
    double: bool = True
    """Whether the network chooses the action that the target network values."""
    through_timeouts: bool = False
    """Whether a timeout is bootstrapped through. That makes a wait that pays an income for ever,
    which an episode of 20 s doesn't give (docs/reproduction/intersection.md)."""
    loss: Loss = "huber"
    """Of temporal differences. The Huber loss (Mnih et al. 2015) bounds the gradient of errors
    above 1, so its minimum is near the median: it learns only a part of the cost of a rare
    collision. The minimum of the squared error is the mean, the value."""
    batch_size: Count = 256
    """Transitions of an update."""
    steps: Count = 5_000_000
    """Environment steps of a run, of all its environments together."""
    steps_per_update: Count = 48
    """The update ratio: environment steps for each gradient step."""
    replay_capacity: Count = 200_000

    @property
    def updates(self) -> int:
        """Gradient steps of a run."""
        return max(self.steps // self.steps_per_update, 1)


@dataclass(frozen=True, kw_only=True)
class DQNHyperparameters(settings.Exploration):
    """Numbers of one run; all are traced, so runs that differ in them share one program."""

    angle: settings.Angle = 0.0
    """α of the reward R(α), in degrees."""
    discount: settings.Discount = 0.99
    """γ."""


PRESETS = {
    "ours": (DQNConfig(), DQNHyperparameters()),
    "thesis": (
        DQNConfig(double=False, batch_size=32, through_timeouts=True),
        DQNHyperparameters(exploration_fall=0.1),
    ),
    "grid": (
        DQNConfig(
            hidden=(64, 64),
            batch_size=64,
            steps=240_000,
            steps_per_update=12,
            replay_capacity=100_000,
        ),
        DQNHyperparameters(learning_rate=1e-3),
    ),
}
"""Settings of experts: ours at the intersection; thesis 5.2, and where it prints nothing the
defaults of Stable-Baselines3, which go through timeouts; and those of a gridworld."""

Scalar = Float[Array, ""]


def next_value(
    target_network: Float[Array, "batch action"], fast: Float[Array, "batch action"], double: bool
) -> Float[Array, " batch"]:
    """Return max_a Q(s', a) by the target network (Mnih et al. 2015).

    Args:
        target_network: Q(s', a) of the target network.
        fast: Q(s', a) of the network itself.
        double: Whether a is chosen by `fast` (van Hasselt et al. 2016).

    Returns:
        The target network's value of the chosen action, of each row.
    """
    chosen = jnp.argmax(fast if double else target_network, axis=-1)
    return jnp.take_along_axis(target_network, chosen[:, None], axis=-1)[:, 0]


def bootstrapped_target(
    reward: Float[Array, " batch"],
    value: Float[Array, " batch"],
    ending: Int[Array, " batch"],
    discount: Scalar | float,
    through_timeouts: bool,
) -> Float[Array, " batch"]:
    """Return Y = R(α) + γ (1 - d) max_a Q(s', a).

    Args:
        reward: R(α) of each row.
        value: max_a Q(s', a) of each row.
        ending: Value of `types.Ending` of each row.
        discount: γ.
        through_timeouts: Whether d = 0 at a timeout, which the clock causes; else d = 1 at every
            ending.

    Returns:
        Y of each row, in units of reward.
    """
    goes_on = ending == int(Ending.NONE)
    if through_timeouts:
        goes_on |= ending == int(Ending.TIMEOUT)
    return reward + discount * jnp.where(goes_on, value, 0.0)


def td_loss(
    q: Float[Array, "batch action"],
    action: Int[Array, " batch"],
    target: Float[Array, " batch"],
    loss: Loss = "huber",
) -> Scalar:
    """Return the mean loss of Q(s, a) against the target.

    Args:
        q: Q of each row and action.
        action: Action taken, of each row.
        target: Y of each row.
        loss: "huber" for Huber's (Mnih et al. 2015), or "squared" for ½ error².

    Returns:
        The mean over the rows.
    """
    taken = jnp.take_along_axis(q, action[:, None], axis=-1)[:, 0]
    of_error = optax.huber_loss if loss == "huber" else optax.l2_loss
    return jnp.mean(of_error(taken, target))


class DQN(Learner):
    """Deep Q-learning on R(α), from a replay that is filled outside JAX."""

    name: ClassVar[str] = "dqn"

    def initialise(self, hyperparameters: HyperparameterArrays) -> tuple[TrainState, Carry]:
        """Draw a network from the run's seed, and make an empty replay."""
        state, key = super().initialise(hyperparameters)
        return state, Carry(
            key, Replay.empty(self.static.replay_capacity, Batch.empty(self.sizes[0]))
        )

    def draw(self, _numbers: Any, _state: TrainState, carry: Carry) -> tuple[Batch, Carry]:
        """Sample the replay.

        Args:
            carry: Random key, and replay.

        Returns:
            A batch of `batch_size` own transitions, and the carry with the next key.
        """
        key, for_batch = jax.random.split(carry.key)
        return carry.replay.sample(for_batch, self.static.batch_size), carry._replace(key=key)

    def loss(
        self, network: Any, target_network: Any, batch: Any, hyperparameters: HyperparameterArrays
    ) -> tuple[Array, Terms]:
        """Return the temporal-difference loss.

        Args:
            network: Network of Q.
            target_network: Network of Q(s', a).
            batch: Own transitions.
            hyperparameters: Numbers of one run.

        Returns:
            The loss, and the terms "loss" and "max_q" (recorded only).
        """
        static = self.static
        fast = jax.vmap(network)(batch.next_observation) if static.double else None
        steady = jax.vmap(target_network)(batch.next_observation)
        value = next_value(steady, steady if fast is None else fast, static.double)
        target = bootstrapped_target(
            score(hyperparameters.weights, batch.target),
            value,
            batch.ending,
            hyperparameters.discount,
            static.through_timeouts,
        )
        q = jax.vmap(network)(batch.observation)
        loss = td_loss(q, batch.action, jax.lax.stop_gradient(target), static.loss)
        return loss, {"loss": loss, "max_q": jnp.max(jnp.abs(q))}

    def policy(
        self, hyperparameters: DQNHyperparameters, state: TrainState, _retained: Any = None
    ) -> QPolicy:
        """Return the policy after the last update.

        Args:
            hyperparameters: Numbers of the run, for the record.
            state: State of the run.

        Returns:
            The trained network as a policy.
        """
        return policy_of(self.static, hyperparameters, state.network)


def policy_of(static: DQNConfig, hyperparameters: DQNHyperparameters, network: QNetwork) -> QPolicy:
    """Return a network as a policy with its record; its soft form, at τ = 1, has no meaning.

    Args:
        static: Config of the run, for the record.
        hyperparameters: Numbers of the run, for the record.
        network: Trained network of the run.

    Returns:
        The policy.
    """
    n_actions = network.layers[-1].out_features
    learner = DQN(static, (0, int(n_actions)))
    return QPolicy.of(network, 1.0, learner.record(hyperparameters))


def train(
    static: DQNConfig,
    hyperparameters: Sequence[DQNHyperparameters],
    sources: Sequence[Source],
    sizes: tuple[int, int],
    callbacks: Callbacks | None = None,
    chunk: int = 200,
) -> Trained:
    """Train one run for each entry of `hyperparameters`, as `learners.iq_learn.train.train`.

    Each run acts between two chunks, in its source (`learners.collect`).

    Args:
        static: Config of all runs.
        hyperparameters: Numbers of each run.
        sources: Source of each run, of `chunk * static.steps_per_update` steps.
        sizes: Features of an observation, and number of actions.
        callbacks: Progress, monitor, checkpoint.
        chunk: Updates between two rounds of acting, and between two calls of the callbacks.

    Returns:
        The trained runs.

    Raises:
        UserError: If there is no run, or not one source for each.
        Stopped: On Ctrl-C.
    """
    if not hyperparameters or len(sources) != len(hyperparameters):
        raise UserError(
            f"{len(hyperparameters)} runs and {len(sources)} sources: pass one for each"
        )
    acts = acting(static, hyperparameters)
    collector = Collector(sources, [run.seed for run in hyperparameters], acts)
    return DQN(static, sizes).train(hyperparameters, callbacks, chunk, collector)


def acting(static: DQNConfig, hyperparameters: Sequence[DQNHyperparameters]) -> Behaviour:
    """Return the ε-greedy behaviour of runs, with ε by the share of the run that is done.

    Args:
        static: Config of all runs; `updates` is the length of a run.
        hyperparameters: Numbers of each run.

    Returns:
        The behaviour of single runs, for a `Collector`.
    """

    def behaviour(network: QNetwork, run: int, done: int, rng: np.random.Generator) -> Act:
        policy = QPolicy.of(network, 1.0, {})
        share = hyperparameters[run].exploring(done / static.updates)

        def act(observation: np.ndarray) -> np.ndarray:
            random = rng.integers(policy.n_actions, size=len(observation))
            explore = rng.random(len(observation)) < share
            return np.where(explore, random, policy.predict(observation)[0])

        return act

    return behaviour
