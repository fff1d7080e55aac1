"""Fitted Q evaluation with a network, where observations hardly recur (the equation: `fitted_q`).

One network has Q_k of both signals and all actions for every k: the steps to go are an input,
drawn again for each row and update, and Q_{k-1} is that of a target network. Each run learns from
episodes drawn with replacement, so the runs of one program are a bootstrap.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from socialiq.evaluation.off_policy.logged import Logged
from socialiq.learners import config
from socialiq.learners.expert_table import draw_between
from socialiq.learners.kernel import Learner, Terms
from socialiq.learners.schedules import cosine
from socialiq.learners.state import HyperparameterArrays, TrainState
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.q_network import network_of
from socialiq.types import RewardPair


@dataclass(frozen=True)
class StaticConfig(config.StaticConfig):
    """Static configuration, which shapes the program."""

    hidden: tuple[int, ...] = (128, 128)
    """Widths of the hidden layers."""
    updates: int = 6000
    """Gradient steps."""
    batch_size: int = 256
    """Rows of an update."""
    horizon: int = 20
    """Largest number of steps to go."""


@dataclass(frozen=True)
class Hyperparameters:
    """Numbers of one run."""

    learning_rate: float = 2e-3
    """Adam's initial rate; it falls as a cosine."""
    polyak: float = 0.02
    """Share of the network mixed into its target network at each update."""
    seed: int = 0
    """Seed of the network and the draws."""
    dataset: int = 0
    """Row of the resamples: which episodes this run learns from."""


class LoggedRows(NamedTuple):
    """Rows of an update, on the device: of all transitions, or drawn.

    Attributes:
        observation: s.
        action: a.
        next_observation: s'.
        goes_on: 1 unless s' is terminal.
        rewards: r_env and r_social.
        chances: ``π(·|s')``.
    """

    observation: Array
    action: Array
    next_observation: Array
    goes_on: Array
    rewards: Array
    chances: Array


class FittedQ(Learner):
    """Q of a fixed policy with k steps to go.

    Attributes:
        logged: All transitions.
        resampled: Row numbers of each resample, (resample, row).
        scale: Standard deviation of each signal's sums over episodes.
    """

    logged: LoggedRows = eqx.field(default=None)  # pyright: ignore[reportAssignmentType]
    resampled: Array = eqx.field(default=None)  # pyright: ignore[reportAssignmentType]
    scale: Array = eqx.field(default=None)  # pyright: ignore[reportAssignmentType]

    StaticConfig: ClassVar[type] = StaticConfig
    Hyperparameters: ClassVar[type] = Hyperparameters
    name: ClassVar[str] = "fitted_q"

    def network(self, key: Array) -> DialNetwork:
        """Draw a network from the observation and the share of steps to go to both signals' Q."""
        one, (n_features, n_actions) = self.static, self.sizes
        return DialNetwork.initialise(
            key, n_features, one.hidden, 2 * n_actions, one.activation, one.view
        )

    def learning_rate(self, hyperparameters: HyperparameterArrays, done: Array) -> Array:
        """Return a rate that falls to 2 % as a cosine."""
        return cosine(hyperparameters.learning_rate, 0.02, done, self.static.updates)

    def draw(
        self,
        hyperparameters: HyperparameterArrays,
        state: TrainState,  # noqa: ARG002
        carry: Any,
    ) -> tuple[Any, Any]:
        """Return rows of the run's resample, and for each its steps to go."""
        key, for_rows, for_steps = jax.random.split(carry, 3)
        mine = self.resampled[hyperparameters.dataset]
        count = self.static.batch_size
        rows = mine[draw_between(for_rows, count, 0, jnp.asarray(len(mine)))]
        to_go = draw_between(for_steps, count, 1, jnp.asarray(self.static.horizon + 1))
        return (jax.tree.map(lambda column: column[rows], self.logged), to_go), key

    def loss(
        self,
        network: Any,
        target_network: Any,
        batch: Any,
        hyperparameters: HyperparameterArrays,  # noqa: ARG002
    ) -> tuple[Float[Array, ""], Terms]:
        """Squared distance to r + E[Q_{k-1}(s', b)], in units of the sums' deviation."""
        rows, to_go = batch
        q = self.values(network, rows.observation, to_go)
        taken = jnp.take_along_axis(q, rows.action[:, None, None], axis=1)[:, 0]
        after = self.values(target_network, rows.next_observation, to_go - 1)
        expected = jnp.einsum("na,nac->nc", rows.chances, after)
        follows = jnp.where(to_go[:, None] > 1, expected, 0.0) * rows.goes_on[:, None]
        loss = jnp.square(taken - rows.rewards / self.scale - follows).mean()
        return loss, {"loss": loss}

    def values(
        self, network: DialNetwork, observation: Array, to_go: Array
    ) -> Float[Array, "row action 2"]:
        """Return Q_k of each row, scaled."""
        share = to_go / self.static.horizon
        q = jax.vmap(network)(observation, RewardPair(share, 1.0 - share))
        return q.reshape(len(observation), self.sizes[1], 2)


def by_network(
    logged: Logged,
    chances: Float[np.ndarray, "state action"],
    counts: Float[np.ndarray, "resample episode"],
    static: StaticConfig | None = None,
    hyperparameters: Hyperparameters | None = None,
) -> Float[np.ndarray, "resample 2"]:
    """Return the sums of r_env and r_social of an episode, for each resample of the episodes.

    Args:
        logged: The episodes.
        chances: The policy's probabilities at each distinct observation.
        counts: How often each episode is in each resample.
        static: Network and training; the horizon is the data's.
        hyperparameters: Rates; each resample has its own seed.
    """
    given = static or StaticConfig()
    shape = {**vars(given), "horizon": logged.horizon}
    data, one = logged.data, hyperparameters or Hyperparameters()
    spread = np.maximum(np.std(np.stack(data.totals(), axis=1), axis=0), 1e-6)
    columns = (
        data.observation,
        data.action,
        data.next_observation,
        np.float32(~data.terminated),
        np.float32(logged.rewards),
        np.float32(chances[logged.next_state]),
    )
    learner = FittedQ(
        StaticConfig(**shape),
        (data.observation.shape[1], data.n_actions),
        None,
        LoggedRows(*map(jnp.asarray, columns)),
        jnp.asarray(_rows(logged, counts)),
        jnp.asarray(spread, jnp.float32),
    )
    numbers = vars(one)
    runs = [
        Hyperparameters(**{**numbers, "seed": one.seed + run, "dataset": run})
        for run in range(len(counts))
    ]
    trained = learner.train(runs)
    first = data.episode_starts
    start, to_go = jnp.asarray(data.observation[first]), jnp.full(len(first), logged.horizon)
    found = []
    for run in range(len(runs)):
        network = network_of(trained.state.target_network, run)
        q = np.asarray(learner.values(network, start, to_go), np.float64)
        value = np.einsum("na,nac->nc", chances[logged.state[first]], q) * spread
        found.append(np.average(value, axis=0, weights=counts[run]))
    return np.array(found)


def _rows(logged: Logged, counts: np.ndarray) -> np.ndarray:
    """Return the rows of each resample's episodes, drawn down or up to as many as all rows."""
    found = []
    for number, one in enumerate(counts):
        rows = np.repeat(np.arange(len(logged.state)), one[logged.data.episode].astype(np.int64))
        found.append(np.random.default_rng(number).choice(rows, len(logged.state)))
    return np.array(found, np.int32)
