"""Configuration of deep Q-learning: static config, which shapes the program, hyperparameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from socialiq.errors import one_of
from socialiq.learners.config import (
    check_above_zero,
    check_counts,
    check_discount,
    check_rate,
    check_seed,
    check_shares,
    check_widths,
)
from socialiq.nn.q_network import ACTIVATIONS
from socialiq.nn.view import CHOICES
from socialiq.social.angle import check_angle

Loss = Literal["huber", "squared"]


@dataclass(frozen=True)
class StaticConfig:
    """Choices that shape the program. Defaults: the experts of thesis 5.2.

    The thesis gives network, learning rate, discount, steps and environments. The rest is of
    Stable-Baselines3's DQN where its default fits (one update of 256 for 4 steps of each of 12
    environments), or chosen here.
    """

    view: str = "flat"
    """Network's view of the vehicles; a name of `nn.view.CHOICES`."""
    hidden: tuple[int, ...] = (256, 256)
    """Widths of the hidden layers."""
    activation: str = "relu"
    """Between the layers."""
    double: bool = True
    """Whether the network chooses the action that the target network values."""
    through_timeouts: bool = False
    """Whether a timeout is bootstrapped through. That makes a wait that pays an income for ever,
    which an episode of 20 s doesn't give (docs/reproduction/intersection.md)."""
    loss: Loss = "huber"
    """Of temporal differences. The Huber loss (Mnih et al. 2015) bounds the gradient of errors
    above 1, so its minimum is near the median: it learns only a part of the cost of a rare
    collision. The minimum of the squared error is the mean, the value."""
    batch_size: int = 256
    """Transitions of an update."""
    steps: int = 5_000_000
    """Environment steps of a run, of all its environments together."""
    steps_per_update: int = 48
    """The update ratio: environment steps for each gradient step."""
    replay_capacity: int = 200_000
    """Size of the replay ring."""

    def __post_init__(self) -> None:
        """Refuse names and sizes that make no run."""
        one_of("view", self.view, tuple(CHOICES))
        one_of("activation", self.activation, tuple(ACTIVATIONS))
        one_of("loss", self.loss, get_args(Loss))
        check_counts(self, ("batch_size", "steps", "steps_per_update", "replay_capacity"))
        check_widths(self.hidden)

    @property
    def updates(self) -> int:
        """Gradient steps of a run."""
        return max(self.steps // self.steps_per_update, 1)


@dataclass(frozen=True)
class Hyperparameters:
    """Numbers of one run; all are traced, so runs that differ in them share one program."""

    angle: float = 0.0
    """α of the reward R(α), in degrees."""
    discount: float = 0.99
    """γ."""
    learning_rate: float = 3e-4
    """Adam's initial learning rate."""
    final_learning_rate: float = 3e-4
    """Adam's final learning rate; in between it falls linearly."""
    polyak: float = 0.005
    """Share of the network mixed into its target network at each update."""
    exploration: float = 0.05
    """Share of random actions, after it has fallen from 1."""
    exploration_fall: float = 0.2
    """Share of the run during which it falls."""
    seed: int = 0
    """Seed of the network, the sampling and the acting."""

    def __post_init__(self) -> None:
        """Refuse numbers outside their range, NaN among them."""
        check_angle(self.angle)
        check_above_zero(self, ("learning_rate", "final_learning_rate"))
        check_discount(self.discount)
        check_rate(self, ("polyak", "exploration_fall"))
        check_shares(self, ("exploration",))
        check_seed(self.seed)

    def exploring(self, progress: float) -> float:
        """Share of random actions when this share of the run is done."""
        return max(
            1.0 - (1.0 - self.exploration) * progress / self.exploration_fall, self.exploration
        )
