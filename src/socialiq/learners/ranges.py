"""Checks that the learners' configurations share; each line names the setting and its range."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from socialiq.errors import UserError


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
    """Refuse what is no seed.

    Raises:
        UserError: If it is negative or has more than 32 bits.
    """
    if not 0 <= seed < 2**32:
        raise UserError(f"seed must lie in [0, 2^32), got {seed}")


def check_seeds(seeds: Sequence[int]) -> None:
    """Refuse what is no seed, and a seed that is named twice.

    Raises:
        UserError: If there is one.
    """
    for seed in seeds:
        check_seed(seed)
    if len({*seeds}) < len(seeds):
        raise UserError("a seed is named twice: name each once")
