"""Policies given as Python code. To load one is to run its author's code, with all your rights."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

from socialiq.errors import UserError
from socialiq.interop.batch_policy import BatchPolicy
from socialiq.interop.content import read_content
from socialiq.interop.record import Interface
from socialiq.plain_text import one_line

# Of foreign code: `SystemExit` would end the audit without a word.
_FAILURES = (Exception, SystemExit)


def read_callable(name: str, source: str, world: Interface) -> tuple[BatchPolicy, bytes]:
    """The policy `MODULE:ATTRIBUTE`; MODULE may be a file's path that ends in .py.

    The attribute is a policy (it has `predict`), a class that makes one without arguments, or a
    function from observations, float32 (batch, features), to one action for each.

    Args:
        name: As above.
        source: How messages call it.
        world: What it has to fit; its answers are held to that.

    Returns:
        The policy, and the source text of its module.

    Raises:
        UserError: If there is no such module or attribute, or its code fails.
    """
    place, _, attribute = name.rpartition(":")
    if not place or not attribute.isidentifier():
        raise UserError(
            f"{source} is no MODULE:ATTRIBUTE: write for instance mine.policies:careful"
        )
    try:
        module = _module(place)
        found = getattr(module, attribute)
        found = found() if inspect.isclass(found) else found
        text = read_content(Path(module.__file__ or ""))
    except UserError:
        raise
    except _FAILURES as error:
        raise _failure(source, error) from error
    if not callable(getattr(found, "predict", found)):
        raise UserError(f"{source} is no policy: it needs `predict`, or to be a function")
    return BatchPolicy(source, world, _decider(found, source)), text


def _module(place: str) -> ModuleType:
    if not place.endswith(".py"):
        return importlib.import_module(place)
    path = Path(place).resolve()
    read_content(path)
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    # A dataclass looks its own module up there.
    sys.modules.setdefault(path.stem, module)
    spec.loader.exec_module(module)
    return module


def _decider(found: Any, source: str) -> Callable[[Any, bool], Any]:
    def decide(batch: Any, deterministic: bool) -> Any:
        try:
            if hasattr(found, "predict"):
                return found.predict(batch, deterministic=deterministic)[0]
            return found(batch)
        except _FAILURES as error:
            raise _failure(source, error) from error

    return decide


def _failure(source: str, error: BaseException) -> UserError:
    return UserError(
        f"{source} raised {type(error).__name__}: {one_line(str(error))}; mend its code"
    )
