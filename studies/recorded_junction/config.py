"""Configuration of the study of a dial at a recorded junction."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from socialiq.errors import UserError, one_of
from socialiq.learners.config import check_counts, check_not_negative, check_shares
from socialiq.learners.offline.config import Hyperparameters, StaticConfig
from socialiq_lab.recorded_practice import Practice

RECORDED, PLANTED, BOTH = "recorded", "planted", "recorded and planted"

CUT = "recorded, views as whole episodes"
"""The recorded drivers, the end of a view taken for the end of an episode."""

SET = "recorded and planted, without closeness"
"""The same as both, by networks that see no closeness (`nn.view`, "set")."""

PRACTISED = "recorded, with practice"
"""The recorded drivers, and what the dials then met while they drove in the world."""

WITH_PLANTED = (PLANTED, BOTH, SET)
"""Mixtures with planted drivers."""

MIXTURES = (CUT, RECORDED, PLANTED, BOTH, SET, PRACTISED)
"""Demonstrations that dials learn from: of the recorded drivers, of planted ones, of all."""


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results.

    The recordings are not part of the package: `recordings` names their folder.
    """

    recordings: str = "commonroad"
    """Folder of the CommonRoad scenarios."""
    files: str = "USA_Lanker*.xml"
    """Pattern of the files: the scenarios of one junction."""
    mixtures: tuple[str, ...] = (CUT, RECORDED, BOTH)
    """Sets of demonstrations, each with its dials; of `MIXTURES`."""
    seeds: tuple[int, ...] = (2100, 2101, 2102)
    """Training seeds. 100 to 199 were used in development."""
    angles: tuple[float, ...] = tuple(np.arange(0.0, 91.0, 15.0).tolist())
    """Angles at which dials are driven, in degrees."""
    every: float = 0.2
    """Seconds between the beginnings of a recorded vehicle's episodes."""
    planted_episodes: int = 200
    """Episodes of each planted driver."""
    exploration: float = 0.1
    """Share of a planted driver's decisions that are drawn at random."""
    first_planted: int = 61_000_000
    """Seed of the first of these episodes."""
    practice: Practice = field(default_factory=lambda: Practice(0))
    """Practice of the mixture that has it."""
    structure: StaticConfig = field(default_factory=lambda: StaticConfig(updates=1500))
    """Static config of the dials, without the length of an episode, which is the world's."""
    numbers: Hyperparameters = field(default_factory=Hyperparameters)
    """Hyperparameters of the dials, without the seed."""
    episodes: int = 600
    """Evaluation episodes of each driver, common to all."""
    checked: int = 0
    """Episodes of each mixture's first dial, at the first angle, in whose states the critics'
    values are compared with rollouts; their seeds follow those of the evaluation. 0: none."""
    first_episode: int = 62_000_000
    """Seed of the first evaluation episode. Those from 50,000,000 on were used in development."""

    def __post_init__(self) -> None:
        """Refuse empty sizes and unknown mixtures."""
        if not self.seeds or not self.mixtures or len(self.angles) < 2:
            raise UserError("name at least one training seed, one mixture and two angles")
        for mixture in self.mixtures:
            one_of("mixture", mixture, MIXTURES)
        if PRACTISED in self.mixtures and not self.practice.rounds:
            raise UserError(f"'{PRACTISED}' has no rounds: add --practice.rounds 5")
        check_counts(self, ("planted_episodes", "episodes"))
        check_not_negative(self, ("checked",))
        check_shares(self, ("exploration",))

    def contents(self) -> dict[str, str]:
        """Return the SHA-256 of each scenario by its file's name.

        Raises:
            UserError: If there is none.
        """
        paths = sorted(Path(self.recordings).glob(self.files))
        if not paths:
            raise UserError(
                f"no file {self.files} in {self.recordings}: name the folder of the CommonRoad "
                "scenarios with --recordings"
            )
        return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in paths}
