"""Configuration of the study of MO-Gymnasium's tasks."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from socialiq.errors import UserError, one_of
from socialiq.storage import packaged_results
from studies.mo_gymnasium.pieces import FOLDER, Piece, read, within
from studies.mo_gymnasium.tasks import TASKS
from studies.mo_gymnasium.training import METHODS, STANDARDISED


@dataclass(frozen=True)
class Config:
    """Configuration of the study; the defaults are the committed results."""

    tasks: tuple[str, ...] = tuple(TASKS)
    """Names of `TASKS`."""
    methods: tuple[str, ...] = METHODS
    """Names of `METHODS`, ours. Peers are read from `pieces`."""
    seeds: tuple[int, ...] = (200, 201, 202, 203, 204)
    """Training seeds of ours. 100 to 199 were used in development; the peers' are 300 to 304."""
    steps: int = 0
    """Steps of a method in the environment; 0 for those of each task."""
    pieces: str = ""
    """Folder of finished pieces, which are not made again; by default the committed ones."""
    again: bool = False
    """Whether ours are trained again although they are there."""
    train: bool = True
    """Whether what is missing of ours is trained; else the tables are of what is there."""

    def __post_init__(self) -> None:
        """Refuse unknown names and empty sizes."""
        for what, names, known in (
            ("task", self.tasks, tuple(TASKS)),
            ("method", self.methods, METHODS),
        ):
            for name in names:
                one_of(what, name, known)
        if not self.tasks or not self.seeds:
            raise UserError("name at least one task and one training seed")
        if self.steps < 0:
            raise UserError(f"steps must be at least 1, or 0 for the task's, got {self.steps}")
        if self.pieces and not Path(self.pieces).is_dir():
            raise UserError(f"{self.pieces} is no folder: name the folder of finished pieces")

    def methods_of(self, task: str) -> tuple[str, ...]:
        """Return the methods of ours that a task has."""
        known = TASKS[task].continuous
        return tuple(one for one in self.methods if known or one != STANDARDISED)

    def budget(self, task: str) -> int:
        """Return the steps that a method may take in a task."""
        return self.steps or TASKS[task].steps

    def kept(self) -> list[Piece]:
        """Return the finished pieces of the tasks, with their steps; peers' of every seed.

        Raises:
            UserError: If a file of the folder is no piece.
        """
        folder = Path(self.pieces or packaged_results() / "mo-gymnasium" / FOLDER)
        found = within(read(folder), {task: self.budget(task) for task in self.tasks})
        ours = () if self.again else self.methods
        return [
            one
            for one in found
            if one.method not in METHODS or (one.method in ours and one.seed in self.seeds)
        ]
