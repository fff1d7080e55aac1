"""Training of IQ-Learn: acting in a world, sampling, and the objective as a learner's loss."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from socialiq.errors import UserError
from socialiq.learners import settings
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.expert_table import Batch, ExpertTable, Replay, shares_of_endings
from socialiq.learners.extensions import checked_divergence, checked_learner, checked_prior
from socialiq.learners.fit import BeforeChunk
from socialiq.learners.iq_learn import losses
from socialiq.learners.iq_learn.config import IQLearnConfig, IQLearnHyperparameters
from socialiq.learners.iq_learn.losses import Divergence
from socialiq.learners.iq_learn.objective import OURS, Batches, UserFunctions, objective
from socialiq.learners.kernel import Learner, Terms, Trained, described
from socialiq.learners.settings import LearnerConfig, LearnerHyperparameters
from socialiq.learners.state import HyperparameterArrays, TrainState
from socialiq.nn.q_network import DuelingNetwork
from socialiq.types import Ending, Simulator, Transitions

ENDINGS_SHARE = 0.01
"""Share of a batch in the average of the replay's endings; that of the first 100 is plain."""


class Carry(NamedTuple):
    """Loop carry of an update; None where a run has no use for a part.

    Attributes:
        key: Random key.
        replay: The learner's own transitions.
        episode: The world's state.
        observation: Of that state.
        cumulative: Cumulative weights of Eq B.2.
        endings: Shares that end in each kind of ending, of the demonstrations and, as an average
            over the batches so far, of the replay.
    """

    key: Array
    replay: Replay | None
    episode: Any
    observation: Float[Array, " feature"] | None
    cumulative: Float[Array, " transition"] | None
    endings: Float[Array, "2 kind"] | None


class IQLearn(Learner):
    """Social Impact Regularized IQ-Learn.

    Attributes:
        simulator: The world to act in; None offline, or when experience is collected outside JAX.
        own: Functions of the user's own in the place of ours.
    """

    simulator: Simulator | None = eqx.field(static=True, default=None)
    own: UserFunctions = eqx.field(static=True, default=OURS)

    StaticConfig: ClassVar[type] = IQLearnConfig
    Hyperparameters: ClassVar[type] = IQLearnHyperparameters
    name: ClassVar[str] = "iq_learn"

    def initialise(self, hyperparameters: HyperparameterArrays) -> tuple[TrainState, Carry]:
        """Draw a network and start an episode, from the run's seed alone."""
        static = self.static
        key, for_network, for_world = jax.random.split(jax.random.key(hyperparameters.seed), 3)
        network: Any = self.network(for_network)
        if static.form == "dueling":
            n_features, n_actions = self.sizes
            tau = hyperparameters.temperature
            shape = (n_features, static.hidden, n_actions, static.activation, static.view)
            network = DuelingNetwork.initialise(for_network, tau, *shape, static.input_scale)
        episode, observation = self.simulator.reset(for_world) if self.simulator else (None, None)
        ring = None
        if static.online:
            ring = Replay.empty(static.replay_capacity, Batch.empty(self.sizes[0]))
        carry = Carry(key, ring, episode, observation, *demonstrated(self, hyperparameters))
        return self.first_state(network), carry

    def draw(
        self, hyperparameters: HyperparameterArrays, state: TrainState, carry: Carry
    ) -> tuple[Batches, Carry]:
        """Act in the world, if there is one, and sample the batches of an update.

        Args:
            hyperparameters: Numbers of one run.
            state: State of the run, with the network that acts.
            carry: Carry of the run.

        Returns:
            The batches, each of `batch_size` rows, and the next carry.

        Args:
            hyperparameters: Numbers of one run.
            state: State of the run, with the network that acts.
            carry: Carry of the run.

        Returns:
            The batches, each of `batch_size` rows, and the next carry.
        """
        assert self.table is not None
        size = self.static.batch_size
        table = self.table
        dataset = hyperparameters.dataset
        key, for_acting, for_expert, for_replay, for_initial = jax.random.split(carry.key, 5)
        carry = carry._replace(key=key)
        if self.simulator is not None:
            carry = self.act(hyperparameters, state.network, carry, for_acting)
        if carry.cumulative is not None:
            expert = table.sample_weighted(for_expert, carry.cumulative, size)
        else:
            expert = table.sample(for_expert, dataset, size)
        replayed = initial = None
        if carry.replay is not None:
            replayed = carry.replay.sample(for_replay, size)
            if carry.endings is not None:
                shares = followed(carry.endings, replayed.ending, state)
                carry = carry._replace(endings=shares)
        if self.static.value_term == "v0":
            initial = table.sample_initial(for_initial, dataset, size)
        return Batches(expert, replayed, initial, carry.endings), carry

    def act(
        self, hyperparameters: HyperparameterArrays, network: Any, carry: Carry, key: Array
    ) -> Carry:
        """Take `env_steps_per_update` steps in the world with the soft policy.

        Args:
            hyperparameters: Numbers of one run.
            network: Network that acts by softmax(Q/τ).
            carry: Carry of the run.
            key: Random key.

        Returns:
            The carry with the new transitions in its replay, and the new place in the world.
        """
        ring = carry.replay
        observation = carry.observation
        episode = carry.episode
        assert self.simulator and ring and observation is not None  # `check_fit` asks for online
        for step_key in jax.random.split(key, self.static.env_steps_per_update):
            for_action, for_step, for_reset = jax.random.split(step_key, 3)
            q = network(observation)
            action = jax.random.categorical(for_action, q / hyperparameters.temperature)
            follows, step = self.simulator.advance(for_step, episode, action)
            ring = ring.add(Batch(observation, action, step.observation, step.ending, step.rewards))
            ended = step.ending != int(Ending.NONE)
            episode, observation = jax.tree.map(
                lambda new, old, ended=ended: jnp.where(ended, new, old),
                self.simulator.reset(for_reset),
                (follows, step.observation),
            )
        return carry._replace(replay=ring, episode=episode, observation=observation)

    def loss(
        self, network: Any, target_network: Any, batch: Any, hyperparameters: HyperparameterArrays
    ) -> tuple[Float[Array, ""], Terms]:
        """Return L_IQ + w L_reg (Eq 4.5), or the loss of the user's own.

        Args:
            network: Network of Q.
            target_network: Network of V(s').
            batch: Rows of the update.
            hyperparameters: Numbers of one run.

        Returns:
            The loss, and its terms by name.
        """
        inputs = (network, target_network, batch, hyperparameters, self.static)
        return self.own.loss(*inputs) if self.own.loss else objective(*inputs, self.own)

    def no_angle(self) -> str:
        """Return why no term of the objective reads an angle; "" if one does."""
        return unread(self.static, super().no_angle(), self.own)

    def functions(self) -> dict[str, Any]:
        """Return the functions of the user's own by their part: name and SHA-256."""
        functions = self.own._replace(divergence=self.own.divergence and self.own.divergence.phi)
        chosen = {
            name: function for name, function in functions._asdict().items() if function is not None
        }
        return super().functions() | {
            f"own_{name}": described(function) for name, function in chosen.items()
        }

    def run_name(self, hyperparameters: IQLearnHyperparameters) -> str:
        """Return the name of a run in messages."""
        run = hyperparameters
        return f"angle {run.angle:g}, strength {run.strength:g}, seed {run.seed}"


def train(
    static: LearnerConfig,
    hyperparameters: LearnerHyperparameters | Sequence[Any],
    datasets: Transitions | Sequence[Transitions],
    simulator: Simulator | None = None,
    callbacks: Callbacks | None = None,
    chunk: int = 500,
    before_chunk: BeforeChunk | None = None,
    *,
    prior: Callable[..., Any] | None = None,
    divergence: Callable[..., Any] | Divergence | None = None,
    loss: Callable[..., Any] | None = None,
    learner: type[Learner] | None = None,
) -> Trained:
    """Train one run for each entry of `hyperparameters`, all in one compiled program.

    It prints nothing. With `callbacks=Callbacks(on_report=lambda now: print(now.done, now.terms))`
    it prints the losses after each `chunk` of updates.

    Args:
        static: Shared by all runs: an `IQLearnConfig`, or the config of `learner`.
        hyperparameters: One entry for each run: `IQLearnHyperparameters`, or those of `learner`;
            an entry alone is one run.
        datasets: Sets of demonstrations, or one; their `dataset` picks the set of each run.
        simulator: The world to act in; None offline, or when `before_chunk` fills the replay.
        callbacks: Progress, monitor, checkpoint.
        chunk: Updates between two calls of the callbacks.
        before_chunk: Adds experience from outside JAX (`learners.collect`).
        prior: The user's own in the place of L_reg: (reward, target, strength) -> scalar.
        divergence: The user's own: φ of rewards, or a `Divergence`.
        loss: The user's own in the place of the whole objective (`UserFunctions`).
        learner: The user's own in the place of IQ-Learn; offline, with its own settings.

    Raises:
        UserError: If settings, data and world don't fit together, or code of the user's own fails.
        Stopped: On Ctrl-C.
    """
    runs, sets = settings.listed(hyperparameters, datasets, simulator)
    config: Any = static
    if learner is not None:
        if any(
            argument is not None for argument in (simulator, before_chunk, prior, divergence, loss)
        ):
            raise UserError("`learner` takes no world, prior, divergence or loss: leave them out")
        own_learner = checked_learner(learner)
        return own_learner.train_on(config, runs, sets, callbacks, chunk)
    if prior is not None and config.prior != "reward":
        raise UserError("a prior of your own replaces --prior reward: leave the setting at that")
    sizes = check_fit(config, runs, sets, simulator, before_chunk is not None)
    functions = UserFunctions(
        checked_prior(prior) if prior else None,
        checked_divergence(divergence) if divergence else None,
        loss,
    )
    # Without a prior no returns are needed, and some data have none.
    kind = "instantaneous" if config.prior == "none" else config.target_kind
    table = ExpertTable.of(sets, kind, config.social_discount)
    iq_learn = IQLearn(config, sizes, table, simulator, functions)
    world = simulator.description if simulator else "offline or collected"
    return iq_learn.train(runs, callbacks, chunk, before_chunk, world)


def unread(static: Any, no_social: str, functions: UserFunctions) -> str:
    """Return why no term of IQ-Learn's objective reads an angle; "" if one does.

    Args:
        static: Config of the run.
        no_social: Reason if the demonstrations have no social rewards, else ""; replay may have
            them.
        functions: Functions of the user's own; a loss is taken to read the angle.

    Returns:
        The reason, a part of a sentence.
    """
    if functions.loss is not None:
        return ""
    if static.prior == "none":
        return "prior 'none' reads no reward"
    if static.prior == "bellman_shift" and static.divergence == "chi2" and not static.shift_term_3:
        return "with divergence chi2 the shift is a constant without a gradient (docs/theory.md)"
    return "" if static.prior == "shifted_chi2" and static.chi2_on == "mixture" else no_social


def demonstrated(learner: Learner, hyperparameters: HyperparameterArrays) -> tuple[Any, Any]:
    """Return cumulative weights and endings of demonstrations, as `Carry` has them.

    Args:
        learner: A learner with demonstrations.
        hyperparameters: Numbers of one run.

    Returns:
        The cumulative weights, None unless the prior is "reweighting"; and the shares of endings,
        None unless an ending has the treatment "occupancy". The second row of the shares, that of
        the replay, is 0.
    """
    table = learner.table
    static = learner.static
    assert table is not None
    cumulative = endings = None
    if static.prior == "reweighting":
        cumulative = jnp.cumsum(losses.table_weights(table, hyperparameters))
    if "occupancy" in static.endings.by_kind().values():
        shares = table.ending_shares(hyperparameters.dataset)
        endings = jnp.stack([shares, jnp.zeros_like(shares)])
    return cumulative, endings


def followed(
    endings: Float[Array, "2 kind"], kinds: Int[Array, " batch"], state: TrainState
) -> Float[Array, "2 kind"]:
    """Mix the endings of a batch of replay into the average, a plain one at first.

    Args:
        endings: Shares of endings: of the demonstrations, and the average over replay.
        kinds: Value of `types.Ending` of each row of the batch.
        state: State of the run, for the number of updates done.

    Returns:
        The shares with a new average.

    Args:
        endings: Shares of endings: of the demonstrations, and the average over replay.
        kinds: Value of `types.Ending` of each row of the batch.
        state: State of the run, for the number of updates done.

    Returns:
        The shares with a new average.
    """
    share = jnp.maximum(ENDINGS_SHARE, 1.0 / (state.optimiser.count + 1))
    batch = shares_of_endings(kinds, jnp.ones(len(kinds), bool))
    return endings.at[1].add(share * (batch - endings[1]))


def check_fit(
    static: IQLearnConfig,
    hyperparameters: Sequence[IQLearnHyperparameters],
    datasets: Sequence[Transitions],
    simulator: Simulator | None,
    collects: bool,
) -> tuple[int, int]:
    """Return (features, actions) of runs that fit data and world.

    Args:
        static: Config of all runs.
        hyperparameters: Numbers of each run.
        datasets: Sets of demonstrations; the sizes of the first one are checked.
        simulator: The world to act in; None without.
        collects: Whether experience comes from outside JAX.

    Returns:
        The sizes.

    Raises:
        UserError: As `settings.check_fit`; or if the returns of the target kind are not known.
    """
    shapes = [(data.observation.shape[1], data.n_actions) for data in datasets[:1]]
    shapes += [(simulator.n_features, simulator.n_actions)] if simulator is not None else []
    acts = simulator is not None or collects
    sizes = settings.check_fit(hyperparameters, len(datasets), static.online, acts, shapes)
    if static.prior != "none":
        for data in datasets:  # raises where returns aren't known
            data.returns(static.target_kind, static.social_discount)
    return sizes
