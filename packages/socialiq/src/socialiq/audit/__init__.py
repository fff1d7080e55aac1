"""Audit whether a policy behaves as its profile declares; `socialiq.audit(...)` calls the package.

A function and a subpackage of one name would hide each other, so the package itself is callable.
"""

import importlib
import sys
import types
from typing import Any

from socialiq.errors import public


class _Callable(types.ModuleType):
    def __call__(self, *arguments: Any, **options: Any) -> Any:
        """Audit a policy, as `socialiq.functions.measure.audit`."""
        # By name: the functions stand above the command line, which stands above this package.
        function = importlib.import_module("socialiq.functions.measure").audit
        return public(function, "audit")(*arguments, **options)


sys.modules[__name__].__class__ = _Callable
