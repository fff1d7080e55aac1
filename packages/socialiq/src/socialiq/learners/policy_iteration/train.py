"""Direct policy iteration: label visited states by rollouts of every action, fit, repeat.

In a state that the current policy visits, each action is taken in a copy of the simulator, and the
policy is followed to the end of the episode. The returns are unbiased samples of Q^π(s, a), with
the simulator's hidden state and future traffic, which all actions of a state share. Their mean over
all states of one observation is what a policy of observations can use. Fitting a network to them
is one approximate step of policy iteration, without bootstrapping: Lagoudakis and Parr 2003
(Reinforcement learning as classification), Lazaric, Ghavamzadeh and Munos 2016 (Analysis of
classification-based policy iteration algorithms). Needs a simulator whose state can be copied; the
trained policy needs none.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq.errors import UserError
from socialiq.learners import replay, settings
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.collect import Act
from socialiq.learners.kernel import Learner, Terms, Trained
from socialiq.learners.settings import Count, Positive, Share
from socialiq.learners.state import HyperparameterArrays, Runs, TrainState
from socialiq.nn.q_network import QNetwork, network_of
from socialiq.nn.q_policy import QPolicy
from socialiq.nn.view import PresentRows, View
from socialiq.social.angle import score
from socialiq.types import RewardPair

Scalar = Float[Array, ""]


@dataclass(frozen=True, kw_only=True)
class IterationConfig(settings.Network, settings.Replay):
    """Choices that shape the program. The ring holds labelled states.

    Older states in the ring were labelled by earlier policies.
    """

    times: int = 0
    """Number of values of the time, the last feature of an observation that ends with a clock;
    0: it doesn't."""
    hidden: settings.Widths = (256, 256)
    batch_size: Count = 256
    """Labelled states of an update."""
    updates: Count = 8_000
    """Gradient steps of a run."""
    states_per_update: Count = 32
    """States that are labelled for each gradient step."""
    first_rounds: Count = 1
    """Rounds of labelling before the first update; a network that improves a given policy would
    learn the few states of one round by heart."""


@dataclass(frozen=True, kw_only=True)
class IterationHyperparameters(settings.Exploration):
    """Numbers of one run; all are traced, so runs that differ in them share one program.

    The policy is the running average of the network. Followed rollouts don't explore.
    """

    angle: settings.Angle = 0.0
    """α of the returns' score, in degrees."""
    learning_rate: Positive = 5e-4
    final_learning_rate: Positive = 2e-5
    value_weight: Share = 0.05
    """Weight in the regression of the error that all actions of a state share; 1: the plain mean
    squared error. Their returns share most of their noise, and no decision depends on it."""
    regression: Share = 0.6
    """Share of the run that fits values to the returns. The rest maximises the expected return of
    softmax(output/τ) alone, which from the start would rule out actions for ever."""
    temperature: Positive = 0.3
    """τ of softmax(output/τ) in the expected return, in units of reward."""
    entropy: Share = 0.01
    """Weight of the policy's entropy in nats, which keeps actions from being ruled out early."""
    exploration: Share = 0.1


class Labelled(NamedTuple):
    """States with the returns of every action.

    Attributes:
        observation: s.
        returns: Pair (G_env, G_social) of each action, undiscounted, each (batch, actions).
    """

    observation: Any
    returns: RewardPair


Labeller = Callable[[Act, Act, np.random.Generator], Labelled]
"""Given the policy that rollouts follow, the one that visits states, and random numbers, returns
labelled states, as many for each chunk."""


def expected_return(
    outputs: Float[Array, "batch action"],
    returns: Float[Array, "batch action"],
    temperature: Scalar | float,
) -> tuple[Float[Array, " batch"], Float[Array, " batch"]]:
    """Return Σ_a π(a|s) (G(s, a) - mean_b G(s, b)), π = softmax(output/τ), and the entropy of π.

    Its maximum over all π is the greedy policy of E[G | s, a]: the cost-sensitive loss of
    Lazaric et al. 2016. The mean over actions changes no gradient, only the loss's variance.
    """
    logs = jax.nn.log_softmax(outputs / temperature, axis=-1)
    gains = returns - returns.mean(axis=-1, keepdims=True)
    chances = jnp.exp(logs)
    return (chances * gains).sum(axis=-1), -(chances * logs).sum(axis=-1)


def regression_error(
    outputs: Float[Array, "batch action"],
    returns: Float[Array, "batch action"],
    value_weight: Scalar | float,
) -> Float[Array, " batch"]:
    """Return half the squared error of outputs, split in two parts by state.

    With e the errors of a state's actions it is ½ mean_a (e_a - ē)² + ½ w ē². For any w > 0 its
    minimum is E[G | s, a] = Q^π(s, a), and w = 1 is the mean squared error.
    """
    errors = outputs - returns
    shared = errors.mean(axis=-1, keepdims=True)
    return 0.5 * ((errors - shared) ** 2).mean(axis=-1) + 0.5 * value_weight * shared[..., 0] ** 2


class Drawn(NamedTuple):
    """A batch of labelled states, and the share of the run that is done."""

    states: Labelled
    progress: Array


class Carry(NamedTuple):
    """A random key and the ring of labelled states."""

    key: Array
    replay: replay.Replay


class PolicyIteration(Learner):
    """Direct policy iteration; the policy is the running average of the network.

    Attributes:
        start: Network that every run begins with; None draws one from the run's seed.
        start_sha256: Of its file, for the record.
    """

    start: Any = None
    start_sha256: str = eqx.field(static=True, default="")

    name: ClassVar[str] = "policy-iteration"

    def record(self, hyperparameters: IterationHyperparameters) -> dict[str, Any]:
        """Return the record of one run, with the policy that it began with."""
        begun = {"start": {"sha256": self.start_sha256}} if self.start is not None else {}
        return super().record(hyperparameters) | begun

    def network(self, key: PRNGKeyArray) -> Any:
        """Draw a network, with an input for each value of the time if there is a clock."""
        static, (n_features, n_actions) = self.static, self.sizes
        shape = (n_features, static.hidden, n_actions, static.activation, static.view)
        return QNetwork.initialise(key, *shape, times=static.times)

    def initialise(self, hyperparameters: HyperparameterArrays) -> tuple[TrainState, Carry]:
        """Draw a network from the run's seed or take the first one, beside an empty ring."""
        state, key = super().initialise(hyperparameters)
        if self.start is not None:
            state = self.first_state(self.start)
        column = jnp.zeros(self.sizes[1], jnp.float32)
        row = Labelled(jnp.zeros(self.labelled_features, jnp.float32), RewardPair(column, column))
        return state, Carry(key, replay.empty_of(self.static.replay_capacity, row))

    @property
    def labelled_features(self) -> int:
        """Length of a labelled observation."""
        return self.sizes[0]

    def draw(
        self,
        hyperparameters: HyperparameterArrays,  # noqa: ARG002
        state: TrainState,
        carry: Carry,
    ) -> tuple[Drawn, Carry]:
        """Sample the ring."""
        key, for_batch = jax.random.split(carry.key)
        batch = replay.sample(carry.replay, for_batch, self.static.batch_size)
        progress = state.optimiser.count / self.static.updates
        return Drawn(batch, progress), carry._replace(key=key)

    def loss(
        self, network: Any, target_network: Any, batch: Any, hyperparameters: HyperparameterArrays
    ) -> tuple[Array, Terms]:
        """The regression's loss, or at the end of the run the expected return's."""
        del target_network
        outputs = jax.vmap(network)(batch.states.observation)
        returns = score(hyperparameters.weights, batch.states.returns)
        error = regression_error(outputs, returns, hyperparameters.value_weight).mean()
        gain, entropy = expected_return(outputs, returns, hyperparameters.temperature)
        gain, entropy = gain.mean(), entropy.mean()
        ending = -gain - hyperparameters.entropy * entropy
        loss = jnp.where(batch.progress < hyperparameters.regression, error, ending)
        return loss, {"loss": loss, "error": error, "gain": gain, "entropy": entropy}

    def greedy(self, network: Any) -> Act:
        """Return the greedy actions of a network."""
        return greedy(QPolicy.of(network, 1.0, {}))

    def policy(
        self,
        hyperparameters: IterationHyperparameters,
        state: TrainState,
        kept: Any = None,  # noqa: ARG002
    ) -> Any:
        """Return the running average of the network as a policy."""
        record = self.record(hyperparameters)
        return QPolicy.of(state.target_network, hyperparameters.temperature, record)


class LabelCollector:
    """Fills each run's ring before a chunk: the `before_chunk` of `Learner.train`.

    Random numbers depend on the run's seed and the number of updates done alone, so that a resumed
    run sees the same states as an uninterrupted one.

    Args:
        learner: Of all runs.
        hyperparameters: One entry for each run.
        labellers: One for each run.
    """

    def __init__(
        self,
        learner: PolicyIteration,
        hyperparameters: Sequence[IterationHyperparameters],
        labellers: Sequence[Labeller],
    ) -> None:
        self._learner, self._static = learner, learner.static
        self._numbers, self._labellers = hyperparameters, labellers
        self._add = jax.jit(jax.vmap(replay.add_many))

    def __call__(self, runs: Runs, done: int) -> Runs:
        """Let every run's policy visit and label states, and store them."""
        batches = [self._labelled(runs, run, done) for run in range(len(self._numbers))]
        stacked = jax.tree.map(lambda *columns: jnp.stack(columns), *batches)
        ring = self._add(runs.carry.replay, stacked)
        return runs._replace(carry=runs.carry._replace(replay=ring))

    def _labelled(self, runs: Runs, run: int, done: int) -> Labelled:
        numbers = self._numbers[run]
        rng = np.random.default_rng(np.random.SeedSequence([numbers.seed, done]))
        follow = self._learner.greedy(network_of(runs.state.target_network, run))
        n_actions = self._learner.sizes[1]
        share = numbers.exploring(done / self._static.updates)

        def visit(observation: np.ndarray) -> np.ndarray:
            random = rng.integers(n_actions, size=len(observation))
            return np.where(rng.random(len(observation)) < share, random, follow(observation))

        rounds = 1 if done else self._static.first_rounds
        labelled = [self._labellers[run](follow, visit, rng) for _ in range(rounds)]
        return jax.tree.map(
            lambda *columns: jnp.asarray(np.concatenate(columns), jnp.float32), *labelled
        )


def greedy(policy: QPolicy) -> Act:
    """Return a policy's greedy actions, fast."""
    encode, layers = split(policy)
    return lambda observation: layers.predict(encode(observation))[0]


def split(policy: QPolicy) -> tuple[Callable[[np.ndarray], np.ndarray], QPolicy]:
    """Return a policy's view, and its layers as a policy of what the view gives.

    A pooled view encodes the present vehicles alone, which is faster.
    """
    view = policy.view
    layers = dataclasses.replace(policy, view=None)
    if isinstance(view, View) and view.choice.pooled:
        return PresentRows(view), layers
    return view or (lambda observation: observation), layers


def train(
    static: IterationConfig,
    hyperparameters: Sequence[IterationHyperparameters],
    labellers: Sequence[Labeller],
    sizes: tuple[int, int],
    callbacks: Callbacks | None = None,
    chunk: int = 200,
    start: QPolicy | None = None,
) -> Trained:
    """Train one run for each entry of `hyperparameters`, all in one compiled program.

    Args:
        static: Shared by all runs.
        hyperparameters: One entry for each run.
        labellers: One for each run, for `chunk * static.states_per_update` states;
            `evaluation.branching.Branching` is that of the intersection.
        sizes: Features of an observation, and number of actions.
        callbacks: Progress, monitor, checkpoint.
        chunk: Updates between two calls of the callbacks, and between two rounds of labelling.
        start: Policy that every run improves; its network must be that of `static`.

    Raises:
        UserError: If there is no run, not one labeller for each, or another first network.
        Stopped: On Ctrl-C.
    """
    learner = PolicyIteration(static, sizes)
    if start is not None:
        network = checked(start.network(), learner)
        learner = PolicyIteration(static, sizes, start=network, start_sha256=start.sha256)
    return trained(learner, hyperparameters, labellers, callbacks, chunk)


def trained(
    learner: PolicyIteration,
    hyperparameters: Sequence[IterationHyperparameters],
    labellers: Sequence[Labeller],
    callbacks: Callbacks | None,
    chunk: int,
) -> Trained:
    """Train the runs of a learner, each with its labeller.

    Raises:
        UserError: If there is no run, or not one labeller for each.
    """
    if not hyperparameters or len(labellers) != len(hyperparameters):
        raise UserError(
            f"{len(hyperparameters)} runs and {len(labellers)} labellers: pass one for each"
        )
    collector = LabelCollector(learner, hyperparameters, labellers)
    return learner.train(hyperparameters, callbacks, chunk, collector, learner.start_sha256)


def checked(network: Any, learner: PolicyIteration) -> Any:
    """Return the network of a first policy.

    Raises:
        UserError: If it is not of the structure that the learner draws.
    """
    drawn_network = jax.eval_shape(learner.network, jax.random.key(0))
    shapes = [[leaf.shape for leaf in jax.tree.leaves(tree)] for tree in (network, drawn_network)]
    if shapes[0] != shapes[1] or network.activation != learner.static.activation:
        raise UserError(
            "the first policy has another network: give its view, hidden widths and activation"
        )
    return network
