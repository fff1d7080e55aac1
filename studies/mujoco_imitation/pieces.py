"""Pieces of the study: files of results that are taken over by later runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.storage import read_json, shipped
from studies.mujoco_imitation.expert import POLICY, RECORD
from studies.mujoco_imitation.methods import METHODS, VARIANTS
from studies.mujoco_imitation.tasks import TASKS

FOLDER = "pieces"

Key = tuple[str, str, int, int]
"""Task, method, trajectories, seed."""


@dataclass(frozen=True)
class Pieces:
    """Content of pieces.

    Attributes:
        experts: By task, the files of an expert by name.
        runs: Of each run, its record.
    """

    experts: dict[str, dict[str, bytes]] = field(default_factory=dict)
    runs: dict[Key, bytes] = field(default_factory=dict)

    def files(self) -> dict[str, bytes]:
        """Return the content of all files by path in a results folder."""
        found = {
            f"{FOLDER}/{task}_{name}": content
            for task, files in self.experts.items()
            for name, content in files.items()
        }
        return found | {f"{FOLDER}/{name_of(key)}": content for key, content in self.runs.items()}


def name_of(key: Key) -> str:
    """Return the name of a run's file."""
    words = "".join(one if one.isalnum() else "_" for one in key[1])
    return f"{key[0]}-{words}-{key[2]}-{key[3]}.json"


def key_of(record: Mapping[str, Any]) -> Key:
    """Return the key of a run's record."""
    return record["task"], record["method"], record["trajectories"], record["seed"]


def committed(folder: str) -> Pieces:
    """Read the pieces of a results folder; none if no folder is named.

    Raises:
        UserError: If it is not there, a file is damaged, or of an unknown task or method.
    """
    if not folder:
        return Pieces()
    place = shipped(Path(folder)) / FOLDER
    if not place.is_dir():
        raise UserError(f"{folder} holds no pieces: name a results folder of this study")
    pieces = Pieces()
    for path in sorted(place.glob("*.json")):
        record = read_json(path)
        task, _, name = path.name.partition("_")
        if name == RECORD:
            policy = place / f"{task}_{POLICY}"
            if not policy.is_file():
                raise UserError(f"{policy} is missing: restore it, or leave out {path.name}")
            pieces.experts[task] = {RECORD: path.read_bytes(), POLICY: policy.read_bytes()}
            continue
        try:
            key = key_of(record)
            known = key[0] in TASKS and key[1] in (*METHODS, *VARIANTS)
            pieces.runs[key] = path.read_bytes()
        except (KeyError, TypeError) as error:
            raise UserError(f"{path} is damaged: restore it or make it again") from error
        if not known:
            what = one_line(f"{key[1]} on {key[0]}")
            raise UserError(
                f"{path} is of {what}, which is unknown here: remove it, or update socialiq"
            )
    return pieces
