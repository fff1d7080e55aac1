"""`data from-arrays` and `data from-trajectories`: NumPy archives as demonstrations."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from socialiq.cli.output import print_json, print_table
from socialiq.datasets.arrays import of_steps
from socialiq.datasets.minari_read import read_minari
from socialiq.datasets.minari_write import id_of, write_minari
from socialiq.datasets.npz import read_npz
from socialiq.datasets.trajectories import of_condensed
from socialiq.demonstrations import files
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.social.angle import check_angle

STEPS = (
    "observation",
    "action",
    "reward",
    "terminated",
    "truncated",
    "ending",
    "episode",
    "next_observation",
    "final_observation",
    "mode",
)
"""Arrays of an archive of steps; the first three must be there (docs/interchange.md)."""

TRAJECTORIES = ("obs", "acts", "rews", "terminal", "indices")
"""Arrays of an archive of trajectories; all must be there."""


@dataclass(frozen=True)
class FromArrays:
    """Read plain arrays, one row for each step, as demonstrations; no environment is made.

    Example: socialiq data from-arrays steps.npz --n-actions 3 --out mine.safetensors
    """

    file: Annotated[Path, tyro.conf.Positional]
    """NumPy archive (.npz) with observation, action, reward of (steps, 2), terminated, ..."""
    out: Path
    """Demonstrations file to write; must not exist."""
    n_actions: int
    """Number of actions of the world."""
    social: str = ""
    """none: a reward of one number a step is r_env, and r_social is 0."""
    mode: tuple[str, ...] = ("demonstrator",)
    """Names of the demonstrators that the array `mode` numbers."""
    flatten: bool = False
    """Lay observations of more axes (images) out in one."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Read, check, write, tell the counts."""

        def read() -> Demonstrations:
            arrays: dict[str, Any] = read_npz(self.file, STEPS)
            missing = [name for name in STEPS[:3] if name not in arrays]
            if missing:
                raise UserError(
                    f"{self.file} has no {', '.join(missing)}: save them by these names"
                )
            return of_steps(
                **arrays,
                n_actions=self.n_actions,
                mode_names=self.mode,
                social=self.social,
                flatten=self.flatten,
                source=_source(self.file),
            )

        return save_new(self.out, read, self.json)


@dataclass(frozen=True)
class FromTrajectories:
    """Read trajectories of the imitation library's .npz archive; its pickled infos stay closed.

    Example: socialiq data from-trajectories rollouts.npz --n-actions 3 --out mine.safetensors
    """

    file: Annotated[Path, tyro.conf.Positional]
    """NumPy archive (.npz) with obs, acts, rews, terminal, indices."""
    out: Path
    """Demonstrations file to write; must not exist."""
    n_actions: int
    """Number of actions of the world."""
    social: str = ""
    """none: a reward of one number a step is r_env, and r_social is 0."""
    mode: str = "demonstrator"
    """Name of the demonstrator."""
    time_limit: int = 0
    """Steps after which the clock cut an episode that the archive calls terminal; 0 for none."""
    flatten: bool = False
    """Lay observations of more axes (images) out in one."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Read, check, write, tell the counts."""

        def read() -> Demonstrations:
            return of_condensed(
                read_npz(self.file, TRAJECTORIES),
                n_actions=self.n_actions,
                mode=self.mode,
                social=self.social,
                time_limit=self.time_limit,
                flatten=self.flatten,
                source=_source(self.file),
            )

        return save_new(self.out, read, self.json)


def save_new(out: Path, read: Callable[[], Demonstrations], as_json: bool) -> int:
    """Write what was read to a new file and tell the counts; the exit status.

    Raises:
        UserError: If the file exists, or nothing can be read.
    """
    if out.exists():
        raise UserError(f"{out} exists already: name a new file, or remove it first")
    table = read()
    sha256 = files.save(out, table)
    counts = [
        {"mode": mode, "episodes": episodes, "transitions": transitions}
        for mode, (episodes, transitions) in table.counts().items()
    ]
    if as_json:
        print_json({"file": str(out), "sha256": sha256, "modes": counts})
    else:
        print_table(counts, f"{out}")
    return 0


def _source(path: Path) -> dict[str, Any]:
    """Where the data came from: the archive's name and bytes."""
    sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    return {"made_by": "socialiq data", "file": path.name, "sha256": sha256}


@dataclass(frozen=True)
class ToMinari:
    """Write demonstrations as a Minari data set (HDF5), the reward pair in its infos.

    Example: socialiq data to-minari mixed.safetensors --out crossing7-v0
    """

    file: Annotated[Path, tyro.conf.Positional]
    """Demonstrations file."""
    out: Path
    """Folder to make. Minari's own root is not touched unless it is named here."""
    id: str = ""
    """Minari's name of the data set, NAME-v0; by default the folder's."""
    angle: float = 0.0
    """Social angle in degrees of the one reward that Minari wants beside the pair."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Read, write, say where."""
        check_angle(self.angle)
        table = files.load(self.file)
        name = self.id or id_of(self.out)
        place = write_minari(table, self.out, dataset_id=name, angle=self.angle)
        sha256 = files.sha256_of(table)
        found = {"folder": str(place), "id": name, "episodes": table.n_episodes, "sha256": sha256}
        if self.json:
            print_json(found)
        else:
            print_table([{k: v for k, v in found.items() if k != "sha256"}])
        return 0


@dataclass(frozen=True)
class FromMinari:
    """Read a Minari data set (HDF5) as demonstrations; no environment is made.

    Example: socialiq data from-minari crossing7-v0 --out mixed.safetensors
    """

    folder: Annotated[Path, tyro.conf.Positional]
    """Folder of the data set."""
    out: Path
    """Demonstrations file to write; must not exist."""
    social: str = ""
    """none: the one reward is r_env, and r_social is 0. Needed for data without a reward pair."""
    mode: str = "demonstrator"
    """Name of the demonstrator, where the data set names none."""
    flatten: bool = False
    """Lay observations of more axes (images) out in one."""
    json: bool = False
    """Print one JSON object."""

    def run(self) -> int:
        """Read, check, write, tell the counts."""

        def read() -> Demonstrations:
            return read_minari(
                self.folder, social=self.social, mode=self.mode, flatten=self.flatten
            )

        return save_new(self.out, read, self.json)
