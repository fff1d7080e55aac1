"""Training of the dial: one network for a range of angles, many runs in one compiled program."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq.errors import UserError
from socialiq.learners import settings
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.dial.config import DialConfig, DialHyperparameters, check_fit
from socialiq.learners.dial.objective import objective
from socialiq.learners.dial.rows import Acting, Rows, draw_directions, draw_rows
from socialiq.learners.expert_table import Batch, ExpertTable, Replay
from socialiq.learners.fit import BeforeChunk
from socialiq.learners.kernel import Learner, Terms, Trained
from socialiq.learners.state import HyperparameterArrays, Runs, TrainState
from socialiq.nn.class_dial import ClassDial
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.dial_policy import DialPolicy, knots_between
from socialiq.nn.q_network import network_of
from socialiq.types import ByClass, Ending, RewardPair, Simulator, Transitions


class Carry(NamedTuple):
    """Loop carry of an update.

    Attributes:
        key: Random key.
        replay: The learner's own transitions; None offline.
        acting: Where it acts; None offline, or if experience comes from outside JAX.
        multiplier: What a `Budget` has made of the prior's weight.
    """

    key: Array
    replay: Replay | None
    acting: Acting | None
    multiplier: Array


class Dial(Learner):
    """IQ-Learn at every angle of a range; its policy is the target network, turned to an angle.

    With `averaging` it is the average of the weights.

    Attributes:
        simulator: The world to act in; None offline, or when experience is collected outside JAX.
    """

    simulator: Simulator | None = eqx.field(static=True, default=None)

    name: ClassVar[str] = "dial"

    def network(self, key: PRNGKeyArray) -> DialNetwork:
        """Draw Q."""
        static = self.static
        n_features, n_actions = self.sizes
        knots = knots_between(static.low - static.margin, static.high + static.margin, static.knots)
        inputs = static.view, static.one_hot, static.times
        shape = (n_features, static.hidden, n_actions, static.activation, *inputs)
        return DialNetwork.initialise(key, *shape, static.heads == "pair", knots, static.classes)

    def initialise(self, hyperparameters: HyperparameterArrays) -> tuple[TrainState, Carry]:
        """Draw networks and start episodes, from the run's seed alone."""
        static = self.static
        key, for_network, for_acting = jax.random.split(jax.random.key(hyperparameters.seed), 3)
        state = self.first_state(self.network(for_network))
        ring = None
        if static.online:
            row = Batch.empty(self.sizes[0])
            zero = jnp.zeros(())
            pair = RewardPair(zero, ByClass(zero, zero) if static.classes else zero)
            row = row._replace(target=pair, direction=pair if static.driven_share else None)
            ring = Replay.empty(static.replay_capacity, row)
        acting = self.begin(for_acting) if self.simulator else None
        return state, Carry(key, ring, acting, jnp.ones(()))

    def begin(self, key: Array) -> Acting:
        """Start fresh episodes at angles drawn for them."""
        assert self.simulator is not None
        for_world, for_angle = jax.random.split(key)
        count = self.static.environments
        begun = jax.vmap(self.simulator.reset)(jax.random.split(for_world, count))
        return Acting(*begun, draw_directions(for_angle, count, self.static, self.static.classes))

    def act(
        self, hyperparameters: HyperparameterArrays, network: DialNetwork, carry: Carry, key: Array
    ) -> Carry:
        """Take one step in every environment, into the replay; an ended episode begins again.

        Args:
            hyperparameters: Numbers of one run, with τ and the share of random actions.
            network: Network that acts by softmax(Q/τ).
            carry: Carry of the run.
            key: Random key.

        Returns:
            The carry with the new transitions in its replay, and the new place in the world.

        Args:
            hyperparameters: Numbers of one run, with τ and the share of random actions.
            network: Network that acts by softmax(Q/τ).
            carry: Carry of the run.
            key: Random key.

        Returns:
            The carry with the new transitions in its replay, and the new place in the world.
        """
        ring = carry.replay
        now = carry.acting
        count = self.static.environments
        assert self.simulator and ring and now  # `check_fit` asks for online training
        for_action, for_chance, for_random, for_step, for_new = jax.random.split(key, 5)
        q = jax.vmap(network)(now.observation, now.direction)
        chosen = jax.random.categorical(for_action, q / hyperparameters.temperature)
        random = jax.random.randint(for_random, (count,), 0, q.shape[-1])
        explores = jax.random.uniform(for_chance, (count,)) < hyperparameters.exploration
        action = jnp.where(explores, random, chosen)
        step_keys = jax.random.split(for_step, count)
        follows, step = jax.vmap(self.simulator.advance)(step_keys, now.episode, action)
        rows = Batch(now.observation, action, step.observation, step.ending, step.rewards)
        if self.static.driven_share:
            rows = rows._replace(direction=now.direction)
        ended = step.ending != int(Ending.NONE)

        def begun(new: Array, old: Array) -> Array:
            return jnp.where(ended.reshape(-1, *[1] * (new.ndim - 1)), new, old)

        going = Acting(follows, step.observation, now.direction)
        acting = jax.tree.map(begun, self.begin(for_new), going)
        return carry._replace(replay=ring.add_many(rows), acting=acting)

    def draw(
        self, hyperparameters: HyperparameterArrays, state: TrainState, carry: Carry
    ) -> tuple[Rows, Carry]:
        """Act in the world, if there is one, and sample rows and angles.

        Args:
            hyperparameters: Numbers of one run.
            state: State of the run, with the network that acts.
            carry: Carry of the run.

        Returns:
            The rows, demonstrations first, and the next carry.

        Args:
            hyperparameters: Numbers of one run.
            state: State of the run, with the network that acts.
            carry: Carry of the run.

        Returns:
            The rows, demonstrations first, and the next carry.
        """
        key, for_acting, for_rows = jax.random.split(carry.key, 3)
        carry = carry._replace(key=key)
        if self.simulator is not None:
            carry = self.act(hyperparameters, state.network, carry, for_acting)
        dataset = hyperparameters.dataset
        return draw_rows(self.static, self.table, dataset, carry.replay, for_rows), carry

    def loss(
        self, network: Any, target_network: Any, batch: Any, hyperparameters: HyperparameterArrays
    ) -> tuple[Float[Array, ""], Terms]:
        """Return the dial's objective.

        Args:
            network: Network of Q.
            target_network: Network of V(s').
            batch: Rows of the update.
            hyperparameters: Numbers of one run.

        Returns:
            The loss, and its terms by name.
        """
        return objective(network, target_network, batch, hyperparameters, self.static)

    def update(
        self, hyperparameters: HyperparameterArrays, state: TrainState, carry: Carry
    ) -> tuple[TrainState, Carry, Terms]:
        """Act, sample rows and angles, and take one Adam step under the multiplier.

        Args:
            hyperparameters: Numbers of one run.
            state: State of the run.
            carry: Carry of the run, with the multiplier.

        Returns:
            The next state and carry, and the terms of the loss with "multiplier".

        Args:
            hyperparameters: Numbers of one run.
            state: State of the run.
            carry: Carry of the run, with the multiplier.

        Returns:
            The next state and carry, and the terms of the loss with "multiplier".
        """
        weighed_now = weighed(hyperparameters, carry.multiplier)
        state, carry, terms = super().update(weighed_now, state, carry)
        return state, carry, terms | {"multiplier": carry.multiplier}

    def retained(self, carry: Carry) -> Array:
        """Return the multiplier, which is part of a policy's temperature."""
        return carry.multiplier

    def policy(
        self, hyperparameters: DialHyperparameters, state: TrainState, multiplier: Any = 1.0
    ) -> DialPolicy | ClassDial:
        """Return the trained dial of one run.

        Args:
            hyperparameters: Numbers of the run, for the temperature and the record.
            state: State of the run.
            multiplier: What `retained` returned, by which the temperature is divided.

        Returns:
            The dial; of the social angle and the class angle with `classes`.

        Args:
            hyperparameters: Numbers of the run, for the temperature and the record.
            state: State of the run.
            multiplier: What `retained` returned, by which the temperature is divided.

        Returns:
            The dial; of the social angle and the class angle with `classes`.
        """
        return dial_of(self.static, hyperparameters, deployed(state), float(np.float64(multiplier)))

    def run_name(self, hyperparameters: DialHyperparameters) -> str:
        """Return the name of a run in messages."""
        return f"dial, seed {hyperparameters.seed}"


def deployed(state: TrainState) -> DialNetwork:
    """Return the network that a policy is made of: the average of the weights, else the target."""
    return state.target_network if state.average is None else state.average


def dial_of(
    static: DialConfig,
    hyperparameters: DialHyperparameters,
    network: DialNetwork,
    multiplier: float = 1.0,
) -> DialPolicy | ClassDial:
    """Return a network as a dial with its record.

    Args:
        static: Config of the run, for the range of angles and the record.
        hyperparameters: Numbers of the run, for the temperature and the record.
        network: Network of one run.
        multiplier: Multiplier of the prior's weight, by which the temperature is divided.

    Returns:
        The dial; of the social angle and the class angle with `classes`.

    Args:
        static: Config of the run, for the range of angles and the record.
        hyperparameters: Numbers of the run, for the temperature and the record.
        network: Network of one run.
        multiplier: Multiplier of the prior's weight, by which the temperature is divided.

    Returns:
        The dial; of the social angle and the class angle with `classes`.
    """
    record = {
        "learner": "dial",
        "structure": dataclasses.asdict(static),
        "numbers": dataclasses.asdict(hyperparameters),
        "multiplier": multiplier,
    }
    temperature = hyperparameters.temperature / multiplier
    kind = ClassDial if static.classes else DialPolicy
    return kind.of(network, temperature, static.low, static.high, record)


def train(
    static: DialConfig,
    hyperparameters: DialHyperparameters | Sequence[DialHyperparameters],
    datasets: Transitions | Sequence[Transitions] = (),
    simulator: Simulator | None = None,
    sizes: tuple[int, int] | None = None,
    callbacks: Callbacks | None = None,
    chunk: int = 500,
    before_chunk: BeforeChunk | None = None,
    budget: BeforeChunk | None = None,
) -> Trained:
    """Train one dial for each entry of `hyperparameters`, as `iq_learn.train.train` does a policy.

    Args:
        static: Config of all runs.
        hyperparameters: Numbers of each run, or those of one run.
        datasets: Sets of demonstrations, or one set.
        simulator: The world to act in; None offline, or when `before_chunk` fills the replay.
        sizes: Features of an observation and number of actions, needed only where neither
            demonstrations nor a simulator tell.
        callbacks: Progress, monitor, checkpoint.
        chunk: Updates between two calls of the callbacks.
        before_chunk: Adds experience from outside JAX (`learners.collect`).
        budget: Moves the multiplier between two chunks (`Budget`).

    Returns:
        The trained runs.

    Raises:
        UserError: If settings, data and world don't fit together.
        Stopped: On Ctrl-C.
    """
    runs, sets = settings.listed(hyperparameters, datasets, simulator)
    sizes = check_fit(static, runs, sets, simulator, sizes, before_chunk is not None)
    if not static.online:
        settings.check_social(sets)
    table = ExpertTable.of(sets, "instantaneous", 1.0) if sets else None
    world = simulator.description if simulator else "offline or collected"

    def in_turn(present: Runs, done: int) -> Runs:
        for hook in (before_chunk, budget):
            present = hook(present, done) if hook else present
        return present

    return Dial(static, sizes, table, simulator).train(runs, callbacks, chunk, in_turn, world)


def weighed(hyperparameters: HyperparameterArrays, multiplier: Array) -> HyperparameterArrays:
    """Return the hyperparameters under a multiplier μ: weight μ w and temperature τ / μ.

    In the primal problem (docs/theory.md) the score then weighs μ times as much against the data's
    χ², while the entropy weighs what it did; and Q keeps its size.

    Args:
        hyperparameters: Numbers of one run.
        multiplier: μ.

    Returns:
        A copy with the changed weight and temperature.

    Args:
        hyperparameters: Numbers of one run.
        multiplier: μ.

    Returns:
        A copy with the changed weight and temperature.
    """
    return hyperparameters.replace(
        prior_weight=hyperparameters.prior_weight * multiplier,
        temperature=hyperparameters.temperature / multiplier,
    )


Regret = Callable[[DialNetwork, int, float], float]
"""Function from a network, its run, and the multiplier of its training to the regret."""

ASCENT_EVERY = 250
"""Usual number of updates between two steps of dual ascent."""


class Look(NamedTuple):
    """Step of the dual ascent: each run's regret after some updates, and multiplier from there."""

    updates: int
    regret: Float[np.ndarray, " run"]
    multiplier: Float[np.ndarray, " run"]


class Budget:
    """Strength by a budget of regret: dual ascent on the multiplier, the `budget` of `train`.

        min_π χ²(ρ_π, ρ_E)   subject to   J_α(π) >= J*_α - ε

    The Lagrange multiplier μ of the constraint weighs the score (`weighed`). Dual ascent raises it
    while the regret J*_α - J_α exceeds the budget ε, and lowers it below. The regret falls with μ
    where the score is that of single steps, so there is one value to find. ε, in units of reward,
    is what a designer declares and an auditor checks, in the place of λ.

    `regret` measures a run's policy at the target angle. A regret of twice the budget moves log μ
    by `step`, within `low` and `high` of μ. `path` has one `Look` for each chunk but the first,
    which learns at μ = 1.

    Raises:
        UserError: If a budget is not positive, or the range of multipliers is empty.
    """

    def __init__(
        self,
        regret: Regret,
        budget: Float[np.ndarray, " run"],
        step: float = 0.3,
        low: float = 1e-2,
        high: float = 1e3,
    ) -> None:
        if not (np.asarray(budget) > 0).all():
            raise UserError("a budget of regret must be above 0: an exact optimum is never certain")
        if not 0 < low < high:
            raise UserError(f"multipliers from {low:g} to {high:g}: give 0 < low < high")
        self._regret = regret
        self._budget = np.asarray(budget, np.float64)
        self._step = step
        self._low = low
        self._high = high
        self.path: list[Look] = []

    def __call__(self, runs: Runs, done: int) -> Runs:
        """Measure every run, and move its multiplier."""
        if not done:
            return runs
        before = np.asarray(runs.carry.multiplier, np.float64)
        networks = runs.state.target_network
        regrets = [
            self._regret(network_of(networks, run), run, float(multiplier))
            for run, multiplier in enumerate(before)
        ]
        regret = np.array(regrets)
        # Bounded: far from the budget every step is as long as any.
        excess = np.clip(regret / self._budget - 1.0, -1.0, 1.0)
        after = np.clip(before * np.exp(self._step * excess), self._low, self._high)
        self.path.append(Look(done, regret, after))
        moved = runs.carry._replace(multiplier=jnp.asarray(after, jnp.float32))
        return runs._replace(carry=moved)
