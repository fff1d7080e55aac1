"""The atlas: trained intersection policies that come with the package, and how each was made.

They lie beside the committed results of the studies that made them.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from socialiq.errors import UserError, one_of
from socialiq.nn.q_policy import QPolicy
from socialiq.storage import packaged_results, read_json

FOLDER = "atlas"
MANIFEST = "manifest.json"
STUDIES = ("intersection", "intersection-networks")
"""Whose results hold a part of it."""


def manifest() -> dict[str, Any]:
    """Every policy by name: file, SHA-256, how it was made, what it does.

    Raises:
        UserError: If the atlas did not come with the package.
    """
    return {name: entry for _, part in _parts() for name, entry in part.items()}


def names() -> tuple[str, ...]:
    """Names of the policies; none where the atlas did not come with the package."""
    try:
        return tuple(manifest())
    except UserError:
        return ()


def load(name: str) -> QPolicy:
    """A policy of the atlas.

    Raises:
        UserError: If the name is unknown, or the file is not the one of the manifest.
    """
    path = path_of(name)
    policy = QPolicy.load(path)
    if policy.sha256 != manifest()[name]["sha256"]:
        raise UserError(f"{path} is not the file of its manifest: install the package anew")
    return policy


def path_of(name: str) -> Path:
    """Where a policy's file lies.

    Raises:
        UserError: If the name is unknown.
    """
    one_of("policy of the atlas", name, names())
    folder, entry = next((folder, part[name]) for folder, part in _parts() if name in part)
    return folder / entry["file"]


def _parts() -> list[tuple[Path, dict[str, Any]]]:
    """Each study's folder of policies, and their entries."""
    folders = [packaged_results() / study / FOLDER for study in STUDIES]
    folders = [folder for folder in folders if folder.is_dir()] or folders[:1]
    return [(folder, read_json(folder / MANIFEST)["policies"]) for folder in folders]
