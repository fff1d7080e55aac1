"""Direct policy iteration of a dial: label visited states by rollouts of every action, fit, repeat.

In a state that the current policy visits, each action is taken in a copy of the simulator, and the
policy is followed to the end of the episode. The returns are unbiased samples of Q^π(s, a), with
the simulator's hidden state and future traffic, which all actions of a state share. Their mean over
all states of one observation is what a policy of observations can use. Fitting a network to them
is one approximate step of policy iteration, without bootstrapping: Lagoudakis and Parr 2003
(Reinforcement learning as classification), Lazaric, Ghavamzadeh and Munos 2016 (Analysis of
classification-based policy iteration algorithms). Needs a simulator whose state can be copied; the
trained policy needs none.

Every episode has an angle. Its states are labelled by rollouts of the dial at this angle, and the
network is fitted to the returns of both rewards, and then to their score. So neighbouring angles
share what is learned.

A run that improves a dial labels states once where the first rounds fill the ring: one step of
policy iteration of that dial, by a new network.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq.errors import UserError
from socialiq.learners import settings
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.collect import BaseCollector
from socialiq.learners.expert_table import Carry, Replay
from socialiq.learners.kernel import Learner, Terms, Trained
from socialiq.learners.settings import Count, Natural, Positive, Share
from socialiq.learners.state import HyperparameterArrays, Runs, TrainState
from socialiq.nn.class_dial import ClassDial
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.dial_policy import DialPolicy, knots_between
from socialiq.nn.q_network import network_of
from socialiq.nn.view import CHOICES, ROWS, PresentRows, View, angle_columns
from socialiq.social.angle import score
from socialiq.types import Act, ByClass, RewardPair

Scalar = Float[Array, ""]


@dataclass(frozen=True, kw_only=True)
class DialIterationConfig(settings.DrawnAngles, settings.Network, settings.Replay):
    """Choices that shape the program.

    The ring holds labelled states; older ones were labelled by earlier policies.
    """

    high_share: Share | None = 0.4
    classes: bool = False
    """Train for every class angle too; an observation then ends with both angles in degrees."""
    knots: Natural = 0
    """Number of hat functions of the angle that the network reads."""
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
    learn the few states of one round by heart. Where they fill the ring no other round follows, and
    a new network improves the given policy."""

    def __post_init__(self) -> None:
        """Refuse names, sizes and angles that make no run."""
        super().__post_init__()
        self.check_high_share()
        if self.classes and self.knots:
            raise UserError("--set knots is of one angle: leave it out with --set classes=true")


@dataclass(frozen=True, kw_only=True)
class IterationHyperparameters(settings.Exploration):
    """Numbers of one run; all are traced, so runs that differ in them share one program.

    The policy is the running average of the network. Followed rollouts don't explore.
    """

    angle: settings.Angle = 0.0
    """Not used: every episode has an angle of its own."""
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


def with_network_of(static: DialIterationConfig, dial: DialPolicy) -> DialIterationConfig:
    """Return a static config for runs that begin with a dial: with its network, for its angles.

    A range of the config that is not the default stays, down to a single angle.

    Raises:
        UserError: If the dial has no pair of values for each action, or reads one-hot inputs, or
            was not trained for the whole range of the config.
    """
    view = dial.turned.view
    if not dial.pairs:
        raise UserError(
            "this dial has no pair of values for each action: train it with --heads pair"
        )
    read = view.choice._replace(layout=ROWS) if isinstance(view, View) else None
    names = [name for name, choice in CHOICES.items() if choice == read]
    if not names or (view is None) != (names == ["flat"]):
        raise UserError("this dial reads a gridworld: give one of the intersection")
    low = static.low
    high = static.high
    if (low, high) == (type(static).low, type(static).high):
        low = dial.low
        high = dial.high
    if not dial.low <= low <= high <= dial.high:
        raise UserError(
            f"this dial is of angles from {dial.low:g} to {dial.high:g}: "
            "give --set low and high within them"
        )
    return replace(
        static,
        view=names[0],
        times=getattr(view, "times", 0),
        hidden=tuple(len(bias) for bias in dial.turned.biases[:-1]),
        activation=dial.turned.activation,
        knots=len(dial.knots),
        low=low,
        high=high,
        high_share=static.high_share if low < static.high_from < high else None,
    )


class Labelled(NamedTuple):
    """States, ending with their angles in degrees, and undiscounted returns (batch, actions)."""

    observation: Any
    returns: RewardPair


Labeller = Callable[[Act, float, np.random.Generator], Labelled]
"""Given the policy that rollouts follow, the share of random actions with which it visits states
(`exploring`), and random numbers, returns labelled states, as many for each chunk."""


def expected_return(
    outputs: Float[Array, "batch action"],
    returns: Float[Array, "batch action"],
    temperature: Scalar | float,
) -> tuple[Float[Array, " batch"], Float[Array, " batch"]]:
    """Return Σ_a π(a|s) (G(s, a) - mean_b G(s, b)), π = softmax(output/τ), and the entropy of π.

    Its maximum over all π is the greedy policy of E[G | s, a]: the cost-sensitive loss of
    Lazaric et al. 2016. The mean over actions changes no gradient, only the loss's variance.

    Args:
        outputs: Outputs of the network for each state and action.
        returns: G(s, a), a sampled return of each state and action.
        temperature: τ, in units of reward.

    Returns:
        The gain of each state in units of reward, and the entropy of π in nats.
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

    Args:
        outputs: Outputs of the network for each state and action.
        returns: G(s, a), a sampled return of each state and action.
        value_weight: w, the weight of the error that all actions of a state share.

    Returns:
        The error of each state.
    """
    errors = outputs - returns
    shared = errors.mean(axis=-1, keepdims=True)
    return 0.5 * ((errors - shared) ** 2).mean(axis=-1) + 0.5 * value_weight * shared[..., 0] ** 2


class DialIteration(Learner):
    """Direct policy iteration at every angle of a range; the policy is a dial.

    Attributes:
        start: Network that every run begins with; None draws one from the run's seed.
        start_sha256: Of the file of the dial that is improved, for the record; None: no dial.
    """

    start: Any = None
    start_sha256: str | None = eqx.field(static=True, default=None)

    name: ClassVar[str] = "dial-policy-iteration"

    def record(self, hyperparameters: IterationHyperparameters) -> dict[str, Any]:
        """Return the record of one run, with the policy that it began with."""
        begun = {} if self.start_sha256 is None else {"start": {"sha256": self.start_sha256}}
        return super().record(hyperparameters) | begun

    def network(self, key: PRNGKeyArray) -> DialNetwork:
        """Draw a network with a pair of values for each action."""
        static = self.static
        n_features, n_actions = self.sizes
        knots = knots_between(static.low - static.margin, static.high + static.margin, static.knots)
        shape = (n_features, static.hidden, n_actions, static.activation, static.view)
        options = {"times": static.times, "pairs": True, "classes": static.classes}
        return DialNetwork.initialise(key, *shape, knots=knots, **options)

    def initialise(self, hyperparameters: HyperparameterArrays) -> tuple[TrainState, Carry]:
        """Draw a network from the run's seed or take the first one, and make an empty ring."""
        state, key = super().initialise(hyperparameters)
        if self.start is not None:
            state = self.first_state(self.start)
        column = jnp.zeros(self.sizes[1], jnp.float32)
        classes = self.static.classes
        returns = RewardPair(column, ByClass(column, column) if classes else column)
        row = Labelled(jnp.zeros(self.sizes[0] + 1 + classes, jnp.float32), returns)
        return state, Carry(key, Replay.empty(self.static.replay_capacity, row))

    def draw(
        self, _numbers: Any, state: TrainState, carry: Carry
    ) -> tuple[tuple[Labelled, Array], Carry]:
        """Sample the ring.

        Args:
            state: State of the run, for the number of updates done.
            carry: Random key, and ring.

        Returns:
            A batch, `batch_size` labelled states and the share of the run that is done, and the
            carry with the next key.
        """
        key, for_batch = jax.random.split(carry.key)
        states = carry.replay.sample(for_batch, self.static.batch_size)
        return (states, state.optimiser.count / self.static.updates), carry._replace(key=key)

    def loss(
        self, network: Any, _target: Any, batch: Any, hyperparameters: HyperparameterArrays
    ) -> tuple[Array, Terms]:
        """Return the regression's loss of both rewards, or at the end the expected score's.

        Args:
            network: Network of (Q_env, Q_social).
            batch: What `draw` returned.
            hyperparameters: Numbers of one run.

        Returns:
            The loss, and the terms "loss", "error", "gain" and "entropy".
        """
        (observation, returns), progress = batch
        features, direction = _turned(observation, self.static.classes)
        values = jax.vmap(network.value_pair)(features, direction)
        errors = [
            regression_error(output, value, hyperparameters.value_weight).mean()
            for output, value in zip(values.parts, returns.parts, strict=True)
        ]
        outputs, gains = (score(_of_rows(direction), pair) for pair in (values, returns))
        gain, entropy = expected_return(outputs, gains, hyperparameters.temperature)
        gain = gain.mean()
        entropy = entropy.mean()
        error = jnp.stack(errors).sum()
        ending = -gain - hyperparameters.entropy * entropy
        loss = jnp.where(progress < hyperparameters.regression, error, ending)
        return loss, {"loss": loss, "error": error, "gain": gain, "entropy": entropy}

    def policy(
        self, hyperparameters: IterationHyperparameters, state: TrainState, _retained: Any = None
    ) -> DialPolicy | ClassDial:
        """Return the running average of the network as a dial.

        Args:
            hyperparameters: Numbers of the run, for the temperature and the record.
            state: State of the run.

        Returns:
            The dial; of the social angle and the class angle with `classes`.
        """
        static = self.static
        record = self.record(hyperparameters)
        kind = kind_of_dial(static)
        temperature = hyperparameters.temperature
        return kind.of(state.target_network, temperature, static.low, static.high, record)


class LabelCollector(BaseCollector):
    """Fills each run's ring with states that its policy visits, labelled by its labeller.

    Given `improved`, it labels states before the first update alone; that dial visits them, and the
    rollouts follow it.
    """

    def __init__(
        self,
        learner: DialIteration,
        hyperparameters: Sequence[IterationHyperparameters],
        labellers: Sequence[Labeller],
        improved: DialPolicy | ClassDial | None = None,
    ) -> None:
        super().__init__([run.seed for run in hyperparameters])
        self._learner = learner
        self._numbers = hyperparameters
        self._labellers = labellers
        self._improved = improved

    def __call__(self, runs: Runs, done: int) -> Runs:
        """Add the labelled states of a chunk, if it has any."""
        if done and self._improved is not None:
            return runs
        return super().__call__(runs, done)

    def collected(self, runs: Runs, done: int, streams: Sequence[np.random.Generator]) -> Labelled:
        """Return the labelled states of a chunk.

        Args:
            runs: State of all runs; the policies are the running averages, unless a dial is
                improved.
            done: Number of updates done.
            streams: Random numbers of each run.

        Returns:
            The labelled states, (run, state, ...).
        """
        batches = [self._labelled(runs, run, done, rng) for run, rng in enumerate(streams)]
        return jax.tree.map(lambda *columns: jnp.stack(columns), *batches)

    def _labelled(self, runs: Runs, run: int, done: int, rng: np.random.Generator) -> Labelled:
        static = self._learner.static
        network = network_of(runs.state.target_network, run)
        current = kind_of_dial(static).of(network, 1.0, static.low, static.high, {})
        follow = Greedy(self._improved or current)
        share = self._numbers[run].exploring(done / static.updates)
        rounds = 1 if done else static.first_rounds
        labelled = [self._labellers[run](follow, share, rng) for _ in range(rounds)]
        return jax.tree.map(
            lambda *columns: jnp.asarray(np.concatenate(columns), jnp.float32), *labelled
        )


def kind_of_dial(static: DialIterationConfig) -> Any:
    """Return the class of the trained dials."""
    return ClassDial if static.classes else DialPolicy


class Greedy:
    """A dial's greedy actions, of observations that end with their angles in degrees.

    A pooled view encodes the present vehicles alone, which is faster.
    """

    def __init__(self, dial: DialPolicy | ClassDial) -> None:
        self._layers = dataclasses.replace(dial.turned, view=None)
        self._encode: Any = dial.turned.view
        if isinstance(self._encode, View) and self._encode.choice.pooled:
            self._encode = PresentRows(self._encode)
        self._classes = isinstance(dial, ClassDial)
        self._knots = getattr(dial, "knots", ())
        self._pairs = dial.pairs

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Return the actions, (batch,)."""
        features, direction = _turned(observation, self._classes)
        encoded = self._encode(features) if self._encode else features
        columns = [encoded, *angle_columns(direction, self._knots)]
        outputs = self._layers.q_values(np.concatenate(columns, axis=-1))
        if self._pairs:
            form = jax.tree.structure(direction)
            values = np.split(outputs, form.num_leaves, axis=1)
            outputs = score(_of_rows(direction), jax.tree.unflatten(form, values))
        return outputs.argmax(axis=1)


def exploring(follow: Act, share: float, n_actions: int, rng: np.random.Generator) -> Act:
    """Return a policy that takes random actions in a share of its decisions.

    Args:
        follow: Policy of all other decisions.
        share: Share of random actions.
        n_actions: Number of actions.
        rng: Random numbers.
    """

    def act(observation: np.ndarray) -> np.ndarray:
        random = rng.integers(n_actions, size=len(observation))
        return np.where(rng.random(len(observation)) < share, random, follow(observation))

    return act


def _turned(observation: Any, classes: bool) -> tuple[Any, RewardPair]:
    """Return observations without the angles in degrees at their ends, and the directions.

    These are (cos α, sin α); with classes the class angle b is last, and sin α has the parts
    (sin α cos b, sin α sin b).
    """
    xp = observation.__array_namespace__()
    angles = 1 + classes
    radians = xp.deg2rad(observation[:, -angles])
    env = xp.cos(radians)
    social = xp.sin(radians)
    if classes:
        of_class = xp.deg2rad(observation[:, -1])
        social = ByClass(social * xp.cos(of_class), social * xp.sin(of_class))
    return observation[:, :-angles], RewardPair(env, social)


def _of_rows(direction: RewardPair) -> RewardPair:
    """Return directions with an axis for the actions."""
    return jax.tree.map(lambda weights: weights[:, None], direction)


def train(
    static: DialIterationConfig,
    hyperparameters: Sequence[IterationHyperparameters],
    labellers: Sequence[Labeller],
    sizes: tuple[int, int],
    callbacks: Callbacks | None = None,
    chunk: int = 200,
    start: DialPolicy | ClassDial | None = None,
) -> Trained:
    """Train one dial for each entry of `hyperparameters`, as `learners.iq_learn.train.train`.

    Args:
        static: Config of all runs.
        hyperparameters: Numbers of each run; the angle is not used.
        labellers: Labeller of each run, of `chunk * static.states_per_update` states for each
            chunk; `evaluation.road_training.dial_labeller` makes those of the intersection.
        sizes: Features of an observation without the angle, and number of actions.
        callbacks: Progress, monitor, checkpoint.
        chunk: Updates between two rounds of labelling, and between two calls of the callbacks.
        start: Dial that every run improves, with the network of `static`; where the first rounds
            fill the ring, a new network improves it. None: each run begins with a new network.

    Returns:
        The trained runs.

    Raises:
        UserError: If there is no run, not one labeller for each, or another first network.
        Stopped: On Ctrl-C.
    """
    if not hyperparameters or len(labellers) != len(hyperparameters):
        raise UserError(
            f"{len(hyperparameters)} runs and {len(labellers)} labellers: pass one for each"
        )
    learner = DialIteration(static, sizes)
    improved = None
    if start is not None:
        network = start.network()
        fresh = jax.eval_shape(learner.network, jax.random.key(0))
        shapes = [[leaf.shape for leaf in jax.tree.leaves(tree)] for tree in (network, fresh)]
        if shapes[0] != shapes[1] or network.activation != static.activation:
            raise UserError(
                "the policy in `start` has another network: give its view, hidden and activation"
            )
        labelled_first = static.first_rounds * chunk * static.states_per_update
        improved = start if labelled_first >= static.replay_capacity else None
        first = network if improved is None else None
        learner = DialIteration(static, sizes, start=first, start_sha256=start.turned.sha256)
    collector = LabelCollector(learner, hyperparameters, labellers, improved)
    return learner.train(hyperparameters, callbacks, chunk, collector, learner.start_sha256 or "")
