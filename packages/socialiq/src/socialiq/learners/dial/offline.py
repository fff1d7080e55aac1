"""Training of the offline dial in three stages: behaviour policy, critics, dial."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from socialiq.errors import UserError
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.continuous.standardise import Standardisation
from socialiq.learners.dial import offline_losses as losses
from socialiq.learners.dial.config import OfflineDialConfig, OfflineDialHyperparameters
from socialiq.learners.dial.offline_losses import Critic, Rows
from socialiq.learners.dial.rows import draw_directions
from socialiq.learners.expert_table import draw_between
from socialiq.learners.kernel import Learner, Terms, Trained
from socialiq.learners.state import HyperparameterArrays, TrainState
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_network import QNetwork, network_of
from socialiq.types import Ending, RewardPair, Transitions

STAGES = ("behaviour", "critics", "dial")
"""Stages of a training, in order."""

_BLOCK = 4096  # rows of a program that computes log β


class Stage(Learner):
    """Common part of the stages: rows at random angles, and a learning rate that falls.

    Attributes:
        rows: Recorded transitions of every run, end to end.
        bounds: First row of each run, and the end.
        units: Unit of the critics' outputs of each run.
        scales: Mean and deviation of each feature in each run's data, with `own_scale`.
        limits: Least and largest returns-to-go of each run's data, with `own_scale`.
    """

    rows: Rows = None  # pyright: ignore[reportAssignmentType]
    bounds: Int[Array, " bound"] = None  # pyright: ignore[reportAssignmentType]
    units: Float[Array, "run 2"] = None  # pyright: ignore[reportAssignmentType]
    scales: Float[Array, "run 2 feature"] | None = None
    limits: Float[Array, "run 2 2"] | None = None

    StaticConfig: ClassVar[type] = OfflineDialConfig
    Hyperparameters: ClassVar[type] = OfflineDialHyperparameters
    number: ClassVar[int] = 0
    """Of the stage: with the run's seed it seeds the network and the sampling."""

    def initialise(self, hyperparameters: HyperparameterArrays) -> tuple[TrainState, Array]:
        """Draw a network; return its state and a random key."""
        seed = jax.random.fold_in(jax.random.key(hyperparameters.seed), self.number)
        key, for_network = jax.random.split(seed)
        return TrainState.of(self.network(for_network)), key

    def draw(
        self, hyperparameters: HyperparameterArrays, _state: TrainState, carry: Array
    ) -> tuple[tuple[Rows, RewardPair], Array]:
        """Return rows of the run's own data, and a direction (cos α, sin α) drawn for each.

        Args:
            hyperparameters: Numbers of one run; `dataset` is the index of the run's data.
            carry: Random key.

        Returns:
            `batch_size` rows with their directions, and the next key.
        """
        key, for_rows, for_angles = jax.random.split(carry, 3)
        static = self.static
        run = hyperparameters.dataset
        chosen = draw_between(for_rows, static.batch_size, self.bounds[run], self.bounds[run + 1])
        directions = draw_directions(for_angles, static.batch_size, static.without_idle_share)
        rows = jax.tree.map(lambda column: column[chosen], self.rows)
        return (rows, directions), key

    def price(
        self, direction: RewardPair, hyperparameters: HyperparameterArrays
    ) -> Float[Array, " row"]:
        """Return η of each row's angle, in units of reward.

        Args:
            direction: (cos α, sin α) of each row.
            hyperparameters: Numbers of one run.
        """
        numbers = hyperparameters
        price = losses.price(direction, numbers.temperature, numbers.end_temperature)
        if not self.static.own_scale:
            return price
        unit = self.units[numbers.dataset]
        return price * jnp.hypot(direction.env * unit[0], direction.social * unit[1])


class Behaviour(Stage):
    """Maximum likelihood of the recorded actions, all demonstrators pooled."""

    name: ClassVar[str] = "offline_dial_behaviour"

    def network(self, key: Any) -> QNetwork:
        """Draw a network of logits."""
        static = self.static
        n_features, n_actions = self.sizes
        shape = (n_features, static.hidden, n_actions, static.activation, static.view)
        return QNetwork.initialise(key, *shape, static.one_hot)

    def loss(
        self, network: Any, _target: Any, batch: Any, _numbers: Any
    ) -> tuple[Float[Array, ""], Terms]:
        """Return the negative log-likelihood of the recorded actions.

        Args:
            network: Network of logits.
            batch: What `draw` returned.

        Returns:
            The loss in nats, and the only term, "loss".
        """
        loss = losses.behaviour_loss(network, batch[0])
        return loss, {"loss": loss}


class Critics(Stage):
    """Behaviour-regularised vector Q-learning."""

    name: ClassVar[str] = "offline_dial_critics"
    number: ClassVar[int] = 1

    def network(self, key: Any) -> Critic:
        """Draw the ensemble."""
        return Critic.ensemble(key, self.sizes, self.static)

    def loss(
        self, network: Any, target_network: Any, batch: Any, hyperparameters: HyperparameterArrays
    ) -> tuple[Float[Array, ""], Terms]:
        """Return the squared Bellman error of both rewards.

        Args:
            network: The ensemble.
            target_network: Running average of the ensemble.
            batch: What `draw` returned.
            hyperparameters: Numbers of one run.

        Returns:
            The loss, and the terms "loss" and "max_target" (recorded only).
        """
        rows, direction = batch
        numbers = hyperparameters
        where = (rows, direction, self.units[numbers.dataset])
        temperature = self.price(direction, numbers)
        target = losses.critic_target(target_network, *where, temperature, numbers.discount)
        if self.limits is not None:  # bootstrapping beyond what was recorded diverges
            target = jnp.clip(target, *self.limits[numbers.dataset])
        loss = losses.critic_loss(network, jax.lax.stop_gradient(target), *where)
        return loss, {"loss": loss, "max_target": jnp.max(jnp.abs(target))}


class Distillation(Stage):
    """The regularised policy as one dial; its values are log-probabilities.

    Attributes:
        critics: Trained ensembles, with a leading axis of runs.
    """

    critics: Critic = None  # pyright: ignore[reportAssignmentType]

    name: ClassVar[str] = "offline_dial"
    number: ClassVar[int] = 2

    def network(self, key: Any) -> DialNetwork:
        """Draw the dial."""
        static = self.static
        n_features, n_actions = self.sizes
        shape = (n_features, static.hidden, n_actions, static.activation, static.view)
        return DialNetwork.initialise(key, *shape, static.one_hot)

    def loss(
        self, network: Any, _target: Any, batch: Any, hyperparameters: HyperparameterArrays
    ) -> tuple[Float[Array, ""], Terms]:
        """Return the distance from the behaviour policy less the score.

        Args:
            network: The dial.
            batch: What `draw` returned.
            hyperparameters: Numbers of one run.

        Returns:
            The loss in nats, and the only term, "loss".
        """
        numbers = hyperparameters
        rows, direction = batch
        temperature = self.price(direction, numbers)
        critics = jax.tree.map(lambda leaf: leaf[numbers.dataset], self.critics)
        unit = self.units[numbers.dataset]
        loss = losses.dial_loss(network, critics, rows, direction, unit, temperature)
        return loss, {"loss": loss}

    def policy(self, hyperparameters: Any, state: TrainState, _retained: Any = None) -> DialPolicy:
        """Return the trained dial, the running average of the network.

        Args:
            hyperparameters: Numbers of the run, for the record.
            state: State of the run.

        Returns:
            The dial, with temperature 1: softmax of its values is the policy.
        """
        static = self.static
        record = self.record(hyperparameters)
        dial = DialPolicy.of(state.target_network, 1.0, static.low, static.high, record)
        if self.scales is None:
            return dial
        scale = np.asarray(self.scales[hyperparameters.dataset], np.float32)
        return Standardisation(*scale).policy(dial)


def train(
    static: OfflineDialConfig,
    hyperparameters: Sequence[OfflineDialHyperparameters],
    datasets: Sequence[Transitions],
    callbacks: Callable[[str], Callbacks] | None = None,
    chunk: int = 500,
) -> dict[str, Trained]:
    """Train dials on recorded episodes and their reward pairs, each on its own, in one program.

    Args:
        static: Config of all runs.
        hyperparameters: Numbers of each run; their `dataset` is set here.
        datasets: Whole episodes of each run.
        callbacks: Function from the name of a stage to the stage's callbacks.
        chunk: Updates between two calls of the callbacks.

    Returns:
        The outcome of each stage, by its name; that of "dial" has the policies.

    Raises:
        UserError: If there is no run, the data differ in features or actions, an episode misses
            steps, the view doesn't fit, or a stage is not finite.
        Stopped: On Ctrl-C.
    """
    if not datasets:
        raise UserError("no runs: pass at least one set of demonstrations")
    sizes = {(int(data.observation.shape[1]), int(data.n_actions)) for data in datasets}
    if len(sizes) > 1:
        raise UserError("the sets of demonstrations have different observations or actions")
    shared: dict[str, Any] = {}
    if static.own_scale:
        scales = [Standardisation.of(data.observation) for data in datasets]
        datasets = [scale.transitions(data) for scale, data in zip(scales, datasets, strict=True)]
        shared["scales"] = jnp.stack([jnp.stack([s.mean, s.deviation]) for s in scales])
        returns = [np.stack(data.returns("to_go", 1.0), axis=1) for data in datasets]
        shared["limits"] = jnp.stack([jnp.stack([r.min(axis=0), r.max(axis=0)]) for r in returns])
    tables, units = zip(*(recorded(data, static.whole_episode) for data in datasets), strict=True)
    bounds = np.cumsum([0, *(len(data.action) for data in datasets)])
    shared |= {"bounds": jnp.asarray(bounds, jnp.int32), "units": jnp.stack(units)}
    size = sizes.pop()
    runs = [replace(run, dataset=n) for n, run in enumerate(hyperparameters)]
    done: dict[str, Trained] = {}

    def finish(name: str, stage: Stage) -> Any:
        trained = stage.train(runs, callbacks(name) if callbacks else None, chunk)
        if trained.failures:
            raise UserError(f"stage {name}, {trained.failures[0]}")
        done[name] = trained
        return trained.state.target_network

    rows = jax.tree.map(lambda *columns: jnp.concatenate(columns), *tables)
    networks = finish("behaviour", Behaviour(static, size, rows=rows, **shared))
    logs = [
        [log_probabilities(network_of(networks, run), side) for side in (table[0], table[2])]
        for run, table in enumerate(tables)
    ]
    now, later = (jnp.concatenate(column) for column in zip(*logs, strict=True))
    if static.own_scale:
        now, later = map(losses.supported, (now, later))
    rows = rows._replace(log_behaviour=now, next_log_behaviour=later)
    longer = replace(static, updates=static.critic_factor * static.updates)
    critics = finish("critics", Critics(longer, size, rows=rows, **shared))
    finish("dial", Distillation(static, size, rows=rows, critics=critics, **shared))
    return done


def recorded(data: Transitions, decisions: int = 0) -> tuple[Rows, Float[Array, " 2"]]:
    """Return all transitions of whole episodes, log β still 0, and the spread of returns-to-go.

    Args:
        data: Recorded episodes of one run.
        decisions: Number of decisions of a whole episode; 0: as many as the longest one.

    Returns:
        The rows, and the standard deviation of the returns-to-go of both rewards, at least 1e-3.

    Raises:
        UserError: If an episode misses steps, or one is longer than a whole one.
    """
    returns = np.stack(data.returns("to_go", 1.0))
    numbers = np.arange(len(data.action))
    starts = np.asarray(data.episode_starts)
    step = numbers - starts[np.searchsorted(starts, numbers, side="right") - 1]
    longest = int(step.max()) + 1
    if decisions and longest > decisions:
        raise UserError(f"an episode has {longest} decisions, more than a whole one: {decisions}")
    horizon = decisions or longest
    empty = jnp.zeros((len(step), data.n_actions), jnp.float32)
    ending = np.asarray(data.ending)
    cut = (ending == int(Ending.TIMEOUT)) & (step + 1 < decisions)
    rows = Rows(
        jnp.asarray(data.observation, jnp.float32),
        jnp.asarray(data.action, jnp.int32),
        jnp.asarray(data.next_observation, jnp.float32),
        jnp.asarray((ending != int(Ending.NONE)) & ~cut),
        jnp.asarray(np.stack(data.rewards, axis=1), jnp.float32),
        jnp.asarray(step / horizon, jnp.float32),
        jnp.asarray((step + 1) / horizon, jnp.float32),
        empty,
        empty,
    )
    unit = np.maximum(returns.std(axis=1), 1e-3)  # rewards that are all 0 have no spread
    return rows, jnp.asarray(unit, jnp.float32)


def log_probabilities(
    network: QNetwork, observation: Float[Array, "row feature"]
) -> Float[Array, "row action"]:
    """Return log softmax of a network's outputs for many rows, block by block.

    Args:
        network: Network of logits.
        observation: Observations, (row, feature).

    Returns:
        The log-probabilities, (row, action).
    """
    compute = jax.jit(lambda block: jax.nn.log_softmax(jax.vmap(network)(block)))
    blocks = [observation[i : i + _BLOCK] for i in range(0, len(observation), _BLOCK)]
    return jnp.concatenate([compute(block) for block in blocks])
