"""Settings that the learners share, and checks of settings; each line names a setting's range."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Any, Literal

from socialiq.errors import UserError, one_of
from socialiq.nn.q_network import ACTIVATIONS
from socialiq.nn.view import CHOICES
from socialiq.social.angle import check_angle


@dataclass(frozen=True)
class StaticConfig:
    """Choices that shape the program; a learner adds its own in a subclass."""

    _: KW_ONLY
    hidden: tuple[int, ...] = (64, 64)
    """Widths of the hidden layers."""
    activation: Literal["relu", "elu"] = "relu"
    """Between the layers."""
    view: str = "flat"
    """Encoding of the vehicles of the intersection for the network; a name of `nn.view.CHOICES`."""
    input_scale: float = 1.0
    """Common factor of all features before the first layer, for features far from 1; a factor for
    each feature would change which states are near each other. Only with view flat."""
    batch_size: int = 64
    """Demonstrated transitions of an update; a learner with a replay draws as many from it."""
    updates: int = 6000
    """Gradient steps of a run."""
    schedule: Literal["constant", "linear"] = "constant"
    """Learning rate over the run: constant, or falling linearly to 0 at its end."""
    averaging: float = 0.0
    """Share of the network that each update mixes into the average of its weights, of which the
    policy is then made (Polyak and Juditsky 1992, with exponential forgetting); the average is
    plain until 1/share updates. 0: the policy is the last network."""

    def __post_init__(self) -> None:
        """Refuse names and sizes that make no run."""
        one_of("activation", self.activation, tuple(ACTIVATIONS))
        one_of("view", self.view, tuple(CHOICES))
        one_of("schedule", self.schedule, ("constant", "linear"))
        check_counts(self, ("batch_size", "updates"))
        check_shares(self, ("averaging",))
        check_above_zero(self, ("input_scale",))
        if self.input_scale != 1.0 and self.view != "flat":
            raise UserError(f"input_scale is only for view flat, not {self.view}: leave it at 1")
        check_widths(self.hidden)


@dataclass(frozen=True)
class Hyperparameters:
    """Numbers of one run, all traced: a grid of runs shares one program. Defaults: Table C.1."""

    angle: float = 0.0
    """α of the reward R(α), in degrees."""
    strength: float = 1.0
    """λ, by which R(α) is scaled."""
    _: KW_ONLY
    temperature: float = 1.0
    """τ of Eq 2.5."""
    discount: float = 0.99
    """γ."""
    learning_rate: float = 3e-4
    """Adam's learning rate."""
    polyak: float = 0.005
    """τ_target, the share of the network mixed into its target network at each update."""
    seed: int = 0
    """Seed of the network, the sampling and the acting."""
    dataset: int = 0
    """Index of the set of demonstrations that this run learns from."""

    def __post_init__(self) -> None:
        """Refuse numbers outside their range, NaN among them."""
        check_angle(self.angle)
        check_not_negative(self, ("strength", "dataset"))
        check_above_zero(self, ("temperature", "learning_rate"))
        check_discount(self.discount)
        check_rate(self, ("polyak",))
        check_seed(self.seed)


def check_counts(config: Any, names: tuple[str, ...]) -> None:
    """Refuse counts below 1.

    Raises:
        UserError: If one is.
    """
    for name in names:
        if getattr(config, name) < 1:
            raise UserError(f"{name} must be at least 1, got {getattr(config, name)}")


def check_widths(hidden: tuple[int, ...]) -> None:
    """Refuse a layer without a unit.

    Raises:
        UserError: If there is one.
    """
    if any(width < 1 for width in hidden):
        raise UserError(f"hidden widths must be at least 1, got {hidden}")


def check_above_zero(config: Any, names: tuple[str, ...]) -> None:
    """Refuse numbers that are not positive and finite.

    Raises:
        UserError: If one isn't.
    """
    for name in names:
        if not (math.isfinite(getattr(config, name)) and getattr(config, name) > 0):
            raise UserError(f"{name} must be above 0, got {getattr(config, name)}")


def check_not_negative(config: Any, names: tuple[str, ...]) -> None:
    """Refuse numbers that are negative or not finite.

    Raises:
        UserError: If one is.
    """
    for name in names:
        if not (math.isfinite(getattr(config, name)) and getattr(config, name) >= 0):
            raise UserError(f"{name} must be 0 or more, got {getattr(config, name)}")


def check_shares(config: Any, names: tuple[str, ...]) -> None:
    """Refuse shares outside [0, 1].

    Raises:
        UserError: If one is.
    """
    for name in names:
        if not 0.0 <= getattr(config, name) <= 1.0:
            raise UserError(f"{name} must lie in [0, 1], got {getattr(config, name)}")


def check_rate(config: Any, names: tuple[str, ...]) -> None:
    """Refuse rates outside (0, 1].

    Raises:
        UserError: If one is.
    """
    for name in names:
        if not 0.0 < getattr(config, name) <= 1.0:
            raise UserError(f"{name} must lie in (0, 1], got {getattr(config, name)}")


def check_discount(discount: float) -> None:
    """Refuse a discount under which an endless episode has no value.

    Raises:
        UserError: If it lies outside [0, 1).
    """
    if not 0.0 <= discount < 1.0:
        raise UserError(f"discount must lie in [0, 1), got {discount}")


def check_seed(seed: int) -> None:
    """Refuse a seed that is negative or has more than 32 bits.

    Raises:
        UserError: If it is one of these.
    """
    if not 0 <= seed < 2**32:
        raise UserError(f"seed must lie in [0, 2^32), got {seed}")


def check_seeds(seeds: Sequence[int]) -> None:
    """Refuse seeds out of range, and a seed that is named twice.

    Raises:
        UserError: If there is one.
    """
    for seed in seeds:
        check_seed(seed)
    if len({*seeds}) < len(seeds):
        raise UserError("a seed is named twice: name each once")
