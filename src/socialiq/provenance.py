"""Provenance of results: versions of libraries, the machine, and a hash of this package's code."""

from __future__ import annotations

import hashlib
import importlib.metadata
import importlib.resources
import platform
from functools import cache
from pathlib import Path

_LIBRARIES = (
    "socialiq",
    "numpy",
    "scipy",
    "numba",
    "gymnasium",
    "jinja2",
    "onnx",
    "onnxruntime",
)

_SUFFIXES = (".py", ".json", ".toml", ".j2")


def versions() -> dict[str, str]:
    """Of Python and the libraries that a number may depend on; those that are missing left out."""
    found = {"python": platform.python_version()}
    for name in _LIBRARIES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def machine() -> str:
    """Kind of processor and system: bits are only promised to be equal on the same."""
    return f"{platform.machine()} {platform.system()}"


@cache
def package_sha256() -> str:
    """SHA-256 over every source file of this package: its path in the package, and its bytes."""
    root = Path(str(importlib.resources.files("socialiq")))
    digest = hashlib.sha256()
    found = {path.relative_to(root).as_posix(): path for path in _sources(root)}
    for name in sorted(found):
        content = found[name].read_bytes()
        digest.update(f"{name}\n{len(content)}\n".encode())
        digest.update(content)
    return digest.hexdigest()


def _sources(root: Path) -> list[Path]:
    inside = (path for path in root.rglob("*") if path.suffix in _SUFFIXES and path.is_file())
    # Results come along in an installed package only; they are data, with hashes of their own.
    return [path for path in inside if path.relative_to(root).parts[0] != "results"]
