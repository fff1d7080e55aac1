"""Provenance of results: versions of libraries, the machine, and a hash of this package's code."""

from __future__ import annotations

import hashlib
import importlib.metadata
import importlib.resources
import platform
from collections.abc import Sequence
from functools import cache
from pathlib import Path

LIBRARIES = ("socialiq", "numpy", "scipy", "numba", "gymnasium", "jinja2", "onnx", "onnxruntime")

_SUFFIXES = (".py", ".json", ".toml", ".j2")


def versions(libraries: Sequence[str] = LIBRARIES) -> dict[str, str]:
    """Return the versions of Python and of those libraries that are installed."""
    numbers = {"python": platform.python_version()}
    for name in libraries:
        try:
            numbers[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return numbers


def machine() -> str:
    """Return processor and system: results are equal to the bit on the same machine only."""
    return f"{platform.machine()} {platform.system()}"


@cache
def package_sha256() -> str:
    """Return the SHA-256 over the paths and bytes of all source files of this package."""
    root = Path(str(importlib.resources.files("socialiq")))
    digest = hashlib.sha256()
    files = {path.relative_to(root).as_posix(): path for path in _sources(root)}
    for name in sorted(files):
        content = files[name].read_bytes()
        digest.update(f"{name}\n{len(content)}\n".encode())
        digest.update(content)
    return digest.hexdigest()


def _sources(root: Path) -> list[Path]:
    inside = (path for path in root.rglob("*") if path.suffix in _SUFFIXES and path.is_file())
    # Results are included in an installed package only; they are data with their own hashes.
    return [path for path in inside if path.relative_to(root).parts[0] != "results"]
