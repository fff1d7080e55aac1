"""Episodes of the intersection: their seeds, common to all policies, and their checked files."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.evaluation.episodes import Episodes
from socialiq.storage import load_arrays, save_arrays
from socialiq.types import RewardPair
from socialiq.worlds.intersection.options import Options

BEST, LAST, DIAL = "best.safetensors", "last.safetensors", "dial.safetensors"
"""Files of a training job: the best network by checks, the last one, a dial."""
CURVE = "curve.csv"
"""File of a training job's learning curve."""
EPISODES, FIRST_EPISODE = 2000, 20_000_000
"""Evaluation episodes of a policy, and the seed of the first, the same for all policies."""
_PAIRS = ("totals", "classical")


@dataclass(frozen=True, kw_only=True)
class EpisodesRun:
    """Episodes on seeds that all policies share."""

    episodes: int = EPISODES
    first_seed: int = FIRST_EPISODE
    options: Options = field(default_factory=Options)

    @property
    def seeds(self) -> np.ndarray:
        """Seed of each episode."""
        return np.arange(self.first_seed, self.first_seed + self.episodes)


def angle_file(angle: float) -> str:
    """Return the name of the file that belongs to an angle in degrees."""
    return f"{angle:g}.safetensors"


def save_episodes(path: Path, episodes: Episodes) -> str:
    """Write the outcomes of episodes to one file.

    Returns:
        The content's SHA-256.

    Raises:
        UserError: If the file can't be written.
    """
    fields = episodes._asdict()
    header = {"signal_names": list(fields.pop("signal_names"))}
    arrays = {}
    for name in _PAIRS:
        pair = fields.pop(name)
        arrays |= {f"{name}_env": pair.env, f"{name}_social": pair.social}
    return save_arrays(path, "episodes", 1, arrays | fields, header)


def load_episodes(path: Path) -> Episodes:
    """Read the outcomes of episodes.

    Raises:
        UserError: If the file is missing, damaged, or holds something else.
    """
    arrays, header = load_arrays(path, "episodes", 1)
    fields: dict[str, Any] = {**arrays, "signal_names": tuple(header["signal_names"])}
    for name in _PAIRS:
        fields[name] = RewardPair(fields.pop(f"{name}_env"), fields.pop(f"{name}_social"))
    return Episodes(**fields)
