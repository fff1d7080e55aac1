"""Policies given as Python code. Loading one runs its author's code with all your rights."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

from socialiq.errors import UserError
from socialiq.foreign import FAILURES, failure, imported
from socialiq.policies.interface import BatchPolicy, Interface
from socialiq.policies.record import read_content


def read_callable(name: str, source: str, world: Interface) -> tuple[BatchPolicy, bytes]:
    """Load the policy `MODULE:ATTRIBUTE`; MODULE may be a file's path that ends in .py.

    The attribute is a policy (it has `predict`), a class that makes one without arguments, or a
    function from observations, float32 (batch, features), to one action for each.

    Args:
        name: As above.
        source: Its name in messages.
        world: The interface for the check of its answers.

    Returns:
        The policy, and the source text of its module.

    Raises:
        UserError: If the module or attribute is missing, or its code fails.
    """
    place, _, attribute = name.rpartition(":")
    if not place or not attribute.isidentifier():
        raise UserError(
            f"{source} is not MODULE:ATTRIBUTE: write for instance mine.policies:careful"
        )
    try:
        if place.endswith(".py"):
            read_content(Path(place))
        module = imported(place)
        found = getattr(module, attribute)
        found = found() if inspect.isclass(found) else found
        text = read_content(Path(module.__file__ or ""))
    except UserError:
        raise
    except FAILURES as error:
        raise failure(source, error) from error
    if not callable(getattr(found, "predict", found)):
        raise UserError(f"{source} is not a policy: it must be a function or have `predict`")
    return BatchPolicy(source, world, _decider(found, source)), text


def _decider(found: Any, source: str) -> Callable[[Any, bool], Any]:
    def decide(batch: Any, deterministic: bool) -> Any:
        try:
            if hasattr(found, "predict"):
                return found.predict(batch, deterministic=deterministic)[0]
            return found(batch)
        except FAILURES as error:
            raise failure(source, error) from error

    return decide
