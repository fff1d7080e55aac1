"""Direct policy iteration of a dial: one network for all angles, improved by rollouts.

Every episode has an angle. Its states are labelled by rollouts of the dial at this angle, and the
network is fitted to the returns of both rewards, and then to their score. So the dial of each
angle is improved as a policy of one angle is (`train`), and neighbouring angles share what is
learned.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PRNGKeyArray

from socialiq.errors import UserError
from socialiq.learners import settings
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.collect import Act
from socialiq.learners.kernel import Terms, Trained
from socialiq.learners.policy_iteration.train import (
    IterationConfig,
    IterationHyperparameters,
    Labeller,
    PolicyIteration,
    checked,
    expected_return,
    regression_error,
    split,
    trained,
)
from socialiq.learners.settings import Natural, Share
from socialiq.learners.state import HyperparameterArrays, TrainState
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.dial_policy import DialPolicy, angle_columns, knots_between
from socialiq.nn.view import CHOICES
from socialiq.social.angle import score
from socialiq.types import RewardPair


@dataclass(frozen=True, kw_only=True)
class DialIterationConfig(settings.DrawnAngles, IterationConfig):
    """Choices that shape the program."""

    high_share: Share | None = 0.4
    knots: Natural = 0
    """Number of hat functions of the angle that the network reads."""

    def __post_init__(self) -> None:
        """Refuse names, sizes and angles that make no run."""
        super().__post_init__()
        self.check_high_share()


def with_network_of(static: DialIterationConfig, dial: DialPolicy) -> DialIterationConfig:
    """Return a static config for runs that begin with a dial: with its network and angles.

    Raises:
        UserError: If the dial has no pair of values for each action, or reads one-hot inputs.
    """
    view = dial.turned.view
    if not dial.pairs:
        raise UserError(
            "this dial has no pair of values for each action: train it with --heads pair"
        )
    names = [name for name, choice in CHOICES.items() if choice == getattr(view, "choice", None)]
    if not names or (view is None) != (names == ["flat"]):
        raise UserError("this dial reads a gridworld: give one of the intersection")
    return replace(
        static,
        view=names[0],
        times=getattr(view, "times", 0),
        hidden=tuple(len(bias) for bias in dial.turned.biases[:-1]),
        activation=dial.turned.activation,
        knots=len(dial.knots),
        low=dial.low,
        high=dial.high,
        high_share=static.high_share if dial.low < static.high_from < dial.high else None,
    )


class DialIteration(PolicyIteration):
    """Direct policy iteration at every angle of a range; the policy is a dial."""

    name: ClassVar[str] = "dial-policy-iteration"

    def network(self, key: PRNGKeyArray) -> DialNetwork:
        """Draw a network with a pair of values for each action."""
        static, (n_features, n_actions) = self.static, self.sizes
        knots = knots_between(static.low - static.margin, static.high + static.margin, static.knots)
        shape = (n_features, static.hidden, n_actions, static.activation, static.view)
        return DialNetwork.initialise(key, *shape, times=static.times, pairs=True, knots=knots)

    @property
    def labelled_features(self) -> int:
        """Length of a labelled observation, which ends with its angle."""
        return self.sizes[0] + 1

    def loss(
        self, network: Any, target_network: Any, batch: Any, hyperparameters: HyperparameterArrays
    ) -> tuple[Array, Terms]:
        """The regression's loss of both rewards, or at the end the expected score's."""
        del target_network
        direction = direction_of(batch.states.observation)
        values = jax.vmap(network.both)(batch.states.observation[:, :-1], direction)
        errors = [
            regression_error(output, value, hyperparameters.value_weight).mean()
            for output, value in zip(values, batch.states.returns, strict=True)
        ]
        outputs, returns = (
            score(of_rows(direction), pair) for pair in (values, batch.states.returns)
        )
        gain, entropy = expected_return(outputs, returns, hyperparameters.temperature)
        gain, entropy, error = gain.mean(), entropy.mean(), errors[0] + errors[1]
        ending = -gain - hyperparameters.entropy * entropy
        loss = jnp.where(batch.progress < hyperparameters.regression, error, ending)
        return loss, {"loss": loss, "error": error, "gain": gain, "entropy": entropy}

    def greedy(self, network: DialNetwork) -> Act:
        """Return the greedy actions of observations that end with their angle."""
        return greedy(DialPolicy.of(network, 1.0, self.static.low, self.static.high, {}))

    def policy(
        self,
        hyperparameters: IterationHyperparameters,
        state: TrainState,
        kept: Any = None,  # noqa: ARG002
    ) -> DialPolicy:
        """Return the running average of the network as a dial."""
        static, record = self.static, self.record(hyperparameters)
        temperature = hyperparameters.temperature
        return DialPolicy.of(state.target_network, temperature, static.low, static.high, record)


def greedy(dial: DialPolicy) -> Act:
    """Return a dial's greedy actions, of observations that end with their angle in degrees."""
    values = values_of(dial)
    return lambda observation: values(observation).argmax(axis=1)


def values_of(dial: DialPolicy) -> Callable[[np.ndarray], np.ndarray]:
    """Return a dial's values of each action, of observations that end with their angle."""
    encode, layers = split(dial.turned)

    def values(observation: np.ndarray) -> np.ndarray:
        direction = direction_of(observation)
        columns = [encode(observation[:, :-1]), *angle_columns(direction, dial.knots)]
        outputs = layers.q_values(np.concatenate(columns, axis=-1))
        if dial.pairs:
            outputs = score(of_rows(direction), RewardPair(*np.split(outputs, 2, axis=1)))
        return outputs

    return values


def direction_of(observation: Any) -> RewardPair:
    """Return (cos α, sin α) of observations that end with their angle in degrees."""
    xp = observation.__array_namespace__()
    radians = xp.deg2rad(observation[:, -1])
    return RewardPair(xp.cos(radians), xp.sin(radians))


def of_rows(direction: RewardPair) -> RewardPair:
    """Return directions with an axis for the actions."""
    return RewardPair(direction.env[:, None], direction.social[:, None])


def train(
    static: DialIterationConfig,
    hyperparameters: Sequence[IterationHyperparameters],
    labellers: Sequence[Labeller],
    sizes: tuple[int, int],
    callbacks: Callbacks | None = None,
    chunk: int = 200,
    start: DialPolicy | None = None,
    kind: type[DialIteration] = DialIteration,
) -> Trained:
    """Train one dial for each entry of `hyperparameters`, all in one compiled program.

    Args:
        static: Shared by all runs.
        hyperparameters: One entry for each run; their angle is not used.
        labellers: One for each run, of observations that end with their angle in degrees.
        sizes: Features of an observation without the angle, and number of actions.
        callbacks: Progress, monitor, checkpoint.
        chunk: Updates between two calls of the callbacks, and between two rounds of labelling.
        start: Dial that every run improves.
        kind: The learner.

    Raises:
        UserError: If there is no run, not one labeller for each, or another first network.
        Stopped: On Ctrl-C.
    """
    learner = kind(static, sizes)
    if start is not None:
        network = checked(start.network(), learner)
        learner = kind(static, sizes, start=network, start_sha256=start.turned.sha256)
    return trained(learner, hyperparameters, labellers, callbacks, chunk)
