"""Configuration of the study."""

from __future__ import annotations

from dataclasses import dataclass

from socialiq.errors import UserError, one_of
from socialiq.learners.settings import check_counts
from studies.mujoco_imitation.methods import METHODS, VARIANTS
from studies.mujoco_imitation.tasks import TASKS

COUNTS = (1, 5, 25)
"""Trajectories of a set of demonstrations, as in the tables."""


@dataclass(frozen=True)
class Config:
    """Configuration of the study. The defaults are the whole plan; what is done of it accumulates.

    A piece is an expert, or one run: a task, a method, a number of trajectories and a seed.
    """

    tasks: tuple[str, ...] = tuple(TASKS)
    """Names of `TASKS`; MuJoCo is the extra mujoco."""
    methods: tuple[str, ...] = tuple(METHODS)
    """Names of `METHODS`."""
    variants: tuple[str, ...] = tuple(VARIANTS)
    """Names of `VARIANTS`, ablations of online imitation: on Hopper, from five trajectories."""
    ablate: bool = True
    """Whether the ablations belong to the plan."""
    trajectories: tuple[int, ...] = COUNTS
    """Trajectories of a set of demonstrations."""
    seeds: tuple[int, ...] = (0, 1, 2, 3, 4)
    """Seeds of imitation, each with a set of demonstrations of its own; 100 to 199 were used in
    development."""
    pieces: str = ""
    """Folder of results whose pieces are taken over and not made again."""
    new: bool = True
    """Whether pieces that are missing are made; else the tables are of those that are there."""
    expert_seed: int = 10
    """Training seed of the experts."""
    expert_updates: int = 0
    """Updates of an expert; 0 for those of its task."""
    updates: int = 0
    """Updates of each imitation; 0 for those of its method."""
    every: int = 20_000
    """Updates between two checkpoints of an expert."""
    judged: int = 10
    """Episodes by which the best of them is chosen."""
    judging_seed: int = 30_000
    """Seed of the first of these; 50,000,000 and later ones were used in development."""
    expert_episodes: int = 50
    """Episodes of an expert's reported return."""
    data_seed: int = 10_000
    """Seed of the first demonstrated trajectory."""
    episodes: int = 10
    """Evaluation episodes of each policy."""
    evaluation_seed: int = 20_000
    """Seed of the evaluation's first states."""

    def __post_init__(self) -> None:
        """Refuse unknown names and empty sizes."""
        check_counts(self, ("every", "judged", "episodes", "expert_episodes"))
        for count in self.trajectories:
            if not 1 <= count <= max(COUNTS):
                raise UserError(f"trajectories must be 1 to {max(COUNTS)}, got {count}")
        for what, names, known in (
            ("task", self.tasks, TASKS),
            ("method", self.methods, METHODS),
            ("variant", self.variants, VARIANTS),
        ):
            for name in names:
                one_of(what, name, tuple(known))
