"""Recorded junctions as scenarios: files of `socialiq data world`, identified by their content."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from socialiq.errors import UserError
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.registry import refuse_file
from socialiq_recordings.world.batch import JunctionBatch
from socialiq_recordings.world.gym import load_world
from socialiq_recordings.world.recorded_world import SCHEMA_VERSION, RecordedWorld

NAME = "recorded-junction"
"""Name of the world in hashes; that of the file says nothing of its content."""

SUFFIX = ".safetensors"


def is_junction(name: str) -> bool:
    """Whether a world's name is that of a file, which only recorded junctions have."""
    return name.endswith(SUFFIX)


@dataclass(frozen=True, eq=False)
class Junction:
    """A recorded junction.

    Attributes:
        world: The world.
        name: Name in hashes, the same for every file.
    """

    world: RecordedWorld
    name: str = NAME

    @staticmethod
    def of(file: str, options: Mapping[str, Any]) -> Junction:
        """Read the file; a path that is not absolute begins in the current folder.

        Raises:
            UserError: If it is missing or no world, or options are given.
        """
        if options:
            raise UserError(
                f"a recorded junction takes no options, got {', '.join(options)}: "
                "`socialiq data world` makes another world"
            )
        if not Path(file).exists():
            raise UserError(
                f"no such file: {file}: the declaration names its world by this path, from the "
                "current folder"
            )
        refuse_file(file)
        return Junction(load_world(file))

    @property
    def n_features(self) -> int:
        """Length of an observation."""
        return self.world.n_features

    @property
    def n_actions(self) -> int:
        """Number of actions."""
        return self.world.n_actions

    @property
    def options(self) -> Options:
        """Options of the reward pair."""
        return self.world.config.options(self.world.max_speed)

    @property
    def description(self) -> str:
        """Format and SHA-256 of the file's content as JSON with sorted keys."""
        described = {"content": self.world.sha256, "format": SCHEMA_VERSION, "name": NAME}
        return json.dumps(described, sort_keys=True, separators=(",", ":"))

    def batch(self, size: int, threads: int = 1) -> JunctionBatch:
        """Return episodes that run side by side."""
        return JunctionBatch(self.world, size, threads)
