"""Priors, divergences and learners of the user's own: loaded by name, checked before use."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from socialiq.errors import UserError, one_of
from socialiq.foreign import FAILURES, failure, imported, one_line
from socialiq.learners.behaviour_cloning import BehaviourCloning
from socialiq.learners.cql import ConservativeQ
from socialiq.learners.iq_learn.losses import Divergence
from socialiq.learners.kernel import Learner

_SAMPLE = np.linspace(-1.0, 1.0, 8, dtype=np.float32)  # rewards on which a function is tried


def load(source: str, option: str, allow_code: bool) -> Any:
    """Import what an option of the command line names as FILE.py:NAME.

    Args:
        source: FILE.py:NAME.
        option: Name of the option, for messages.
        allow_code: Whether the file may be imported: its author's code runs with your rights.

    Returns:
        The function or class of that name.

    Raises:
        UserError: If the code may not run, or there is no such file or name, or it fails.
    """
    file, _, name = source.rpartition(":")
    label = one_line(source)
    if not file.endswith(".py") or not name.isidentifier():
        raise UserError(f"{option} {label} is no FILE.py:NAME: write for instance mine.py:l1")
    if not allow_code:
        raise UserError(
            f"{option} {label} runs its author's code with your rights: "
            "allow that with --allow-code"
        )
    try:
        attribute = getattr(imported(file), name, None)
    except UserError:
        raise
    except FAILURES as error:
        raise failure(label, error) from error
    if attribute is None:
        raise UserError(f"{one_line(file)} has no '{name}': name a function or class of it")
    return attribute


def checked_prior(prior: Callable[..., Any]) -> Callable[..., Any]:
    """Return a prior that was tried on eight rewards.

    Raises:
        UserError: If it fails, or its value or slope is not finite, or its value is no scalar.
    """
    what = f"prior '{_name(prior)}'"
    if not callable(prior):
        raise UserError(f"{what} must be a function (reward, target, strength) -> scalar")
    rewards = jnp.asarray(_SAMPLE)
    value = _tried(what, lambda: jnp.asarray(prior(rewards, rewards[::-1], jnp.asarray(0.5))))
    if value.shape != () or not jnp.issubdtype(value.dtype, jnp.floating):
        raise UserError(
            f"{what} must return a scalar, got {value.dtype}{list(value.shape)}: take the mean "
            "over the rewards"
        )
    slope = _tried(what, lambda: jax.grad(prior)(rewards, rewards[::-1], jnp.asarray(0.5)))
    _check_finite(what, value, slope)
    return prior


def checked_divergence(divergence: Any) -> Divergence:
    """Return a divergence of a function φ, or a `Divergence`, that was tried on eight rewards.

    Raises:
        UserError: If it fails, or a value is not finite, or not one for each reward.
    """
    what = f"divergence '{_name(divergence)}'"
    if isinstance(divergence, Divergence):
        checked = divergence
    elif callable(divergence):
        phi: Callable[[Any], Any] = divergence
        checked = Divergence(phi, jax.grad(lambda rewards: jnp.sum(phi(rewards))), None)
    else:
        raise UserError(f"{what} must be a function φ of rewards, or a Divergence")
    rewards = jnp.asarray(
        _SAMPLE if checked.floor is None else np.abs(_SAMPLE) + max(checked.floor, 0)
    )
    value = _tried(what, lambda: jnp.asarray(checked.phi(rewards)))
    if value.shape != rewards.shape:
        raise UserError(
            f"{what} must return one value for each reward, got shape {list(value.shape)} for "
            f"{list(rewards.shape)}"
        )
    _check_finite(what, value, _tried(what, lambda: checked.slope(rewards)))
    return checked


LEARNERS: dict[str, type[Learner]] = {
    "behaviour-cloning": BehaviourCloning,
    "cql": ConservativeQ,
}
"""Learners beside IQ-Learn that train from demonstrations alone, by name."""


def find_learner(name: str | type[Any], option: str, allow_code: bool) -> type[Learner]:
    """Return a learner by its name in `LEARNERS`, or the user's own by FILE.py:NAME, as `load`.

    Args:
        name: Name, or FILE.py:NAME; or the class.
        option: Name of the option of the command line, for messages.
        allow_code: Whether the file may be imported: its author's code runs with your rights.

    Returns:
        The learner's class.

    Raises:
        UserError: If there is none, or its code may not run or fails.
    """
    if isinstance(name, type):
        return checked_learner(name)
    if ":" not in name:
        one_of("learner", name, (*LEARNERS, "FILE.py:NAME"))
    return LEARNERS.get(name) or checked_learner(load(name, option, allow_code))


def checked_learner(learner: Any) -> type[Learner]:
    """Return a learner's class.

    Raises:
        UserError: If it is no subclass of `Learner`.
    """
    if not (inspect.isclass(learner) and issubclass(learner, Learner)):
        raise UserError(
            f"learner '{_name(learner)}' must be a class that derives from "
            "socialiq.learners.kernel.Learner"
        )
    return learner


def _tried(what: str, call: Callable[[], Any]) -> Any:
    try:
        return call()
    except UserError:
        raise
    except FAILURES as error:
        raise failure(what, error) from error


def _check_finite(what: str, value: Any, slope: Any) -> None:
    for name, values in (("value", value), ("slope", slope)):
        if not bool(jnp.isfinite(values).all()):
            raise UserError(f"{what}: its {name} is not finite on rewards in [-1, 1]")


def _name(function: Any) -> str:
    return one_line(str(getattr(function, "__name__", type(function).__name__)))
