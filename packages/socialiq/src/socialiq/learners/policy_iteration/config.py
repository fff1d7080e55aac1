"""Configuration of direct policy iteration."""

from __future__ import annotations

from dataclasses import dataclass

from socialiq.errors import one_of
from socialiq.learners.config import (
    check_above_zero,
    check_counts,
    check_rate,
    check_seed,
    check_shares,
    check_widths,
)
from socialiq.nn.q_network import ACTIVATIONS
from socialiq.nn.view import CHOICES
from socialiq.social.angle import check_angle


@dataclass(frozen=True)
class StaticConfig:
    """Choices that shape the program."""

    view: str = "flat"
    """Network's view of the vehicles; a name of `nn.view.CHOICES`."""
    times: int = 0
    """Number of values of the time, the last feature of an observation that ends with a clock;
    0: it doesn't."""
    hidden: tuple[int, ...] = (256, 256)
    """Widths of the hidden layers."""
    activation: str = "relu"
    """Between the layers."""
    batch_size: int = 256
    """Labelled states of an update."""
    updates: int = 8_000
    """Gradient steps of a run."""
    states_per_update: int = 32
    """States that are labelled for each gradient step."""
    first_rounds: int = 1
    """Rounds of labelling before the first update; a network that improves a given policy would
    learn the few states of one round by heart."""
    replay_capacity: int = 100_000
    """Size of the ring of labelled states; older ones were labelled by earlier policies."""

    def __post_init__(self) -> None:
        """Refuse names and sizes that make no run."""
        one_of("view", self.view, tuple(CHOICES))
        one_of("activation", self.activation, tuple(ACTIVATIONS))
        names = ("batch_size", "updates", "states_per_update", "first_rounds", "replay_capacity")
        check_counts(self, names)
        check_widths(self.hidden)


@dataclass(frozen=True)
class Hyperparameters:
    """Numbers of one run; all are traced, so runs that differ in them share one program."""

    angle: float = 0.0
    """α of the returns' score, in degrees."""
    learning_rate: float = 5e-4
    """Adam's initial learning rate."""
    final_learning_rate: float = 2e-5
    """Adam's final learning rate; in between it falls linearly."""
    value_weight: float = 0.05
    """Weight in the regression of the error that all actions of a state share; 1: the plain mean
    squared error. Their returns share most of their noise, and no decision depends on it."""
    regression: float = 0.6
    """Share of the run that fits values to the returns. The rest maximises the expected return of
    softmax(output/τ) alone, which from the start would rule out actions for ever."""
    temperature: float = 0.3
    """τ of softmax(output/τ) in the expected return, in units of reward."""
    entropy: float = 0.01
    """Weight of the policy's entropy in nats, which keeps actions from being ruled out early."""
    polyak: float = 0.005
    """Share of the network mixed at each update into its running average, the policy."""
    exploration: float = 0.1
    """Share of random actions in the visited states, after it has fallen from 1. Followed
    rollouts don't explore."""
    exploration_fall: float = 0.2
    """Share of the run during which it falls."""
    seed: int = 0
    """Seed of the network, the sampling and the acting."""

    def __post_init__(self) -> None:
        """Refuse numbers outside their range, NaN among them."""
        check_angle(self.angle)
        check_above_zero(self, ("learning_rate", "final_learning_rate", "temperature"))
        check_rate(self, ("polyak", "exploration_fall"))
        check_shares(self, ("exploration", "entropy", "regression", "value_weight"))
        check_seed(self.seed)

    def exploring(self, progress: float) -> float:
        """Share of random actions when this share of the run is done."""
        fallen = 1.0 - (1.0 - self.exploration) * progress / self.exploration_fall
        return max(fallen, self.exploration)
