"""Fitted Q evaluation (Le, Voloshin and Yue 2019): regressions on the logged transitions.

With k steps to go, for each signal r,

    Q_k(s, a) = E[ r + (1 - terminated) Σ_b π(b|s') Q_{k-1}(s', b) | s, a ],    Q_0 = 0

and J = E[ Σ_a π(a|s_0) Q_H(s_0, a) ]: H regressions are the sum over H steps, without discounting.
Every transition serves each k, as neither dynamics nor rewards may depend on the time unless it is
observed. So a reward that is paid for running out of time counts as one of its state.

Where observations hardly recur, one network has Q_k of both signals and all actions for every k,
from standardised features: the steps to go are an input, drawn again for each row and update, and
Q_{k-1} is that of a target network. Each run learns from episodes drawn with replacement, so the
runs of one program are a bootstrap: `counts` are how often each episode is in each resample, and
`chances` the policy's probabilities at each distinct observation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from scipy.sparse import csr_array

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.learners import settings
from socialiq.learners.continuous.standardise import Standardisation
from socialiq.learners.expert_table import draw_between
from socialiq.learners.kernel import Learner, Terms
from socialiq.learners.state import HyperparameterArrays, TrainState, cosine
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.q_network import network_of
from socialiq.types import RewardPair

Chances = Callable[[np.ndarray], np.ndarray]
"""Probabilities of a policy's actions, (state, action), for observations (state, feature)."""


@dataclass(frozen=True, eq=False)
class Logged:
    """Whole episodes, their distinct observations numbered.

    Attributes:
        data: The episodes.
        observations: Every distinct observation.
        state: Number of each row's observation.
        next_state: Number of each row's next observation.
        horizon: Steps of the longest episode: the time limit, if one was cut.
    """

    data: Demonstrations
    observations: Float[np.ndarray, "state feature"]
    state: Int[np.ndarray, " transition"]
    next_state: Int[np.ndarray, " transition"]
    horizon: int

    @staticmethod
    def of(data: Demonstrations) -> Logged:
        """Number the observations.

        Raises:
            UserError: If steps of an episode are missing, or there is one episode only.
        """
        data.totals()  # refuses episodes with gaps
        if data.n_episodes < 2:
            raise UserError("one episode has no interval: give two episodes or more")
        rows = np.concatenate([data.observation, data.next_observation])
        distinct, number = np.unique(rows, axis=0, return_inverse=True)
        state, next_state = np.split(number.reshape(-1), 2)
        return Logged(data, distinct, state, next_state, int(data.step.max()) + 1)

    @property
    def tabular(self) -> bool:
        """Whether observations recur often enough for tables: five times in the mean."""
        return 5 * len(np.unique(self.state)) <= len(self.state)

    @property
    def rewards(self) -> Float[np.ndarray, "transition 2"]:
        """Return r_env and r_social as columns."""
        return np.stack(self.data.rewards, axis=1)

    def chances(self, policy: Chances) -> Float[np.ndarray, "state action"]:
        """Return a policy's probabilities at every distinct observation.

        Raises:
            UserError: If the policy is not one of the data's actions.
        """
        chances = np.asarray(policy(self.observations), np.float64)
        if chances.shape != (len(self.observations), self.data.n_actions):
            raise UserError(
                f"the policy has {chances.shape[-1]} actions, the data {self.data.n_actions}: "
                "give data of the world it was trained for"
            )
        return chances

    @property
    def modes(self) -> list[int]:
        """Modes that have episodes."""
        return np.unique(self.data.episode_modes).tolist()

    def by_step(self, values: np.ndarray, fill: float) -> np.ndarray:
        """Return values of rows as (episode, step, ...).

        Args:
            values: A value for each transition.
            fill: Value beyond an episode's end.
        """
        shape = (self.data.n_episodes, self.horizon, *values.shape[1:])
        filled = np.full(shape, fill, np.float64)
        filled[self.data.episode, self.data.step] = values
        return filled


def tabular(
    logged: Logged,
    chances: Float[np.ndarray, "state action"],
    counts: Float[np.ndarray, "resample episode"],
) -> tuple[Float[np.ndarray, "resample 2"], Float[np.ndarray, " resample"]]:
    """Evaluate by means over equal observations and actions.

    Args:
        logged: Whole episodes.
        chances: The policy's probabilities at each distinct observation.
        counts: Number of times that each episode is in each resample.

    Returns:
        For each resample the sums of r_env and r_social of an episode, and the share of episodes in
        which the policy comes to an action that the data do not show in that observation. The mean
        of the actions that they show stands for it.
    """
    data = logged.data
    n_states, n_actions = chances.shape
    columns = (logged.state * n_actions + data.action, logged.next_state, ~data.terminated)
    # Equal transitions are one kind. The third signal is that of having left the data.
    distinct, kinds = np.unique(
        np.stack([*columns, *data.rewards], axis=1), axis=0, return_inverse=True
    )
    cell = distinct[:, 0].astype(int)
    follows = distinct[:, 1].astype(int)
    goes_on = distinct[:, 2]
    signals = np.concatenate([distinct[:, 3:], np.zeros((len(distinct), 1))], axis=1)
    times = np.bincount(
        data.episode * len(cell) + kinds.reshape(-1), minlength=data.n_episodes * len(cell)
    )
    weight = counts @ times.reshape(data.n_episodes, -1)
    into = csr_array(
        (np.ones(len(cell)), (np.arange(len(cell)), cell)), (len(cell), n_states * n_actions)
    )
    size = weight @ into
    covered = (size > 0).reshape(-1, n_states, n_actions)
    value = np.zeros((len(counts), n_states, 3))
    for _ in range(logged.horizon):
        target = signals + goes_on[:, None] * value[:, follows]
        sums = [(weight * target[..., signal]) @ into for signal in range(3)]
        mean = np.stack(sums, axis=2) / np.maximum(size, 1e-12)[:, :, None]
        q = mean.reshape(-1, n_states, n_actions, 3)
        # Cells without data get the mean of the state's other actions, and have left it.
        among = (q * covered[..., None]).sum(axis=2)
        among = among / np.maximum(covered.sum(axis=2), 1)[..., None]
        q = np.where(covered[..., None], q, among[:, :, None])
        q[..., 2] = np.where(covered, q[..., 2], 1.0)
        value = np.einsum("sa,rsac->rsc", chances, q)
    start = logged.state[data.episode_starts]
    means = np.einsum("re,rec->rc", counts, value[:, start]) / counts.sum(axis=1)[:, None]
    return means[:, :2], means[:, 2]


@dataclass(frozen=True)
class StaticConfig(settings.LearnerConfig):
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
    """Transitions on the device; `goes_on` is 1 unless s' is terminal, `chances` are π in s'."""

    observation: Array
    action: Array
    next_observation: Array
    goes_on: Array
    rewards: Array
    chances: Array


class FittedQ(Learner):
    """Q of a fixed policy with k steps to go, from all logged transitions.

    Attributes:
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
        static = self.static
        n_features, n_actions = self.sizes
        return DialNetwork.initialise(
            key, n_features, static.hidden, 2 * n_actions, static.activation, static.view
        )

    def learning_rate(self, hyperparameters: HyperparameterArrays, done: Array) -> Array:
        """Return a rate that falls to 2 % as a cosine.

        Args:
            hyperparameters: Numbers of the run, with its initial rate.
            done: Number of updates that are done.
        """
        return cosine(hyperparameters.learning_rate, 0.02, done, self.static.updates)

    def draw(
        self, hyperparameters: HyperparameterArrays, _state: TrainState, carry: Any
    ) -> tuple[Any, Any]:
        """Return rows of the run's resample, and for each its steps to go.

        Args:
            hyperparameters: Numbers of the run, with the row of its resample.
            _state: Not used.
            carry: Key of random numbers.

        Returns:
            The rows and the steps to go, from 1 to the horizon; and the next key.
        """
        key, for_rows, for_steps = jax.random.split(carry, 3)
        resample = self.resampled[hyperparameters.dataset]
        count = self.static.batch_size
        rows = resample[draw_between(for_rows, count, 0, jnp.asarray(len(resample)))]
        to_go = draw_between(for_steps, count, 1, jnp.asarray(self.static.horizon + 1))
        return (jax.tree.map(lambda column: column[rows], self.logged), to_go), key

    def loss(
        self, network: Any, target_network: Any, batch: Any, _numbers: Any
    ) -> tuple[Float[Array, ""], Terms]:
        """Squared distance to r + E[Q_{k-1}(s', b)], in units of the sums' deviation.

        Args:
            network: Network that learns Q_k.
            target_network: Network that gives Q_{k-1}.
            batch: Rows and steps to go, as `draw` returns them.
            _numbers: Not used.

        Returns:
            The mean over rows and signals, and the same as a term of the record.
        """
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
        """Return Q_k of each row, in units of the sums' deviation.

        Args:
            network: The network.
            observation: Observation of each row.
            to_go: Number k of steps to go, of each row.
        """
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
    """Return the sums of r_env and r_social of an episode by networks, for each resample.

    Args:
        logged: Whole episodes; their horizon replaces that of `static`.
        chances: The policy's probabilities at each distinct observation.
        counts: Number of times that each episode is in each resample.
        static: Static configuration; None for the default.
        hyperparameters: Numbers of the first network; each further one has the next seed. None for
            the default.
    """
    scale = Standardisation.of(logged.data.observation)
    data = scale.transitions(logged.data)
    numbers = hyperparameters or Hyperparameters()
    spread = np.maximum(np.std(np.stack(data.totals(), axis=1), axis=0), 1e-6)
    columns = (
        data.observation,
        data.action,
        data.next_observation,
        np.float32(~data.terminated),
        np.float32(logged.rewards),
        np.float32(chances[logged.next_state]),
    )
    resampled = []  # rows of each resample's episodes, drawn down or up to as many as all rows
    for run, count in enumerate(counts):
        rows = np.repeat(np.arange(len(logged.state)), count[data.episode].astype(np.int64))
        resampled.append(np.random.default_rng(run).choice(rows, len(logged.state)))
    learner = FittedQ(
        replace(static or StaticConfig(), horizon=logged.horizon),
        (data.observation.shape[1], data.n_actions),
        None,
        LoggedRows(*map(jnp.asarray, columns)),
        jnp.asarray(np.array(resampled, np.int32)),
        jnp.asarray(spread, jnp.float32),
    )
    runs = [replace(numbers, seed=numbers.seed + run, dataset=run) for run in range(len(counts))]
    trained = learner.train(runs)
    first = data.episode_starts
    start = jnp.asarray(data.observation[first])
    to_go = jnp.full(len(first), logged.horizon)
    means = []
    for run in range(len(runs)):
        network = network_of(trained.state.target_network, run)
        q = np.asarray(learner.values(network, start, to_go), np.float64)
        value = np.einsum("na,nac->nc", chances[logged.state[first]], q) * spread
        means.append(np.average(value, axis=0, weights=counts[run]))
    return np.array(means)
