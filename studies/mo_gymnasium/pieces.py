"""Pieces of the study: one JSON file for a task, a method and a seed, ours or a peer's."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from socialiq.errors import UserError
from socialiq.storage import read_json
from studies.mo_gymnasium.tasks import TASKS

FOLDER = "pieces"


@dataclass(frozen=True)
class Piece:
    """Outcome of one training.

    Attributes:
        task: Name in `TASKS`.
        method: Its name in the tables.
        seed: Training seed.
        steps: Steps taken in the environment to learn, those of its experts included.
        evaluation_steps_while_training: Steps of evaluations that decide what is trained next.
        angles: Angle of each policy that can be turned, in degrees; None for a set of policies.
        totals: Mean totals (first, second reward) of each angle, or of each policy of the set.
        settings: Settings that are not the method's own defaults.
        seconds: Time of the training.
        versions: Versions of the libraries.
    """

    task: str
    method: str
    seed: int
    steps: int
    evaluation_steps_while_training: int
    angles: list[float] | None
    totals: list[list[float]]
    settings: dict[str, Any]
    seconds: float
    versions: dict[str, str]

    @property
    def file(self) -> str:
        """Name of its file."""
        short = "".join(one if one.isalnum() else "_" for one in self.method)
        return f"{self.task}-{short}-{self.seed}.json"

    @property
    def points(self) -> Float[np.ndarray, "policy 2"]:
        """Mean totals of each policy."""
        return np.array(self.totals, np.float64).reshape(-1, 2)

    def content(self) -> bytes:
        """Return the content of its file: one line of JSON."""
        return (json.dumps(asdict(self), allow_nan=False) + "\n").encode()


def read(folder: Path) -> list[Piece]:
    """Return every piece of a folder, by name; none if the folder doesn't exist.

    Raises:
        UserError: If a file is no piece.
    """
    return [_read(path) for path in sorted(folder.glob("*.json"))]


def _read(path: Path) -> Piece:
    try:
        found = Piece(**read_json(path))
        shape = np.array(found.totals, np.float64).shape
        listed = found.angles is None or len(found.angles) == len(found.totals)
    except (TypeError, ValueError) as error:
        raise UserError(f"{path} is no piece of mo-gymnasium: restore or remove it") from error
    if found.task not in TASKS or shape != (len(found.totals), 2) or not (listed and shape[0]):
        raise UserError(f"{path} is no piece of mo-gymnasium: restore or remove it")
    if not np.isfinite(found.points).all() or path.name != found.file:
        raise UserError(f"{path} is damaged or has another's name: restore or remove it")
    return found


def within(pieces: Iterable[Piece], steps: dict[str, int]) -> list[Piece]:
    """Return the pieces of these tasks whose methods were allowed these steps.

    Pieces of ours say so as `allowed_steps` of their settings: where episodes of experts end early,
    fewer are taken. Of the others it is told by the steps taken: at most, and nearly, these.
    """
    return [one for one in pieces if one.task in steps and _allowed(one, steps[one.task])]


def _allowed(piece: Piece, steps: int) -> bool:
    if "allowed_steps" in piece.settings:
        return piece.settings["allowed_steps"] == steps and piece.steps <= steps
    return 0.9 * steps <= piece.steps <= steps
