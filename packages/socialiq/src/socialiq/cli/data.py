"""`data from-arrays`, `to-arrays`, `from-trajectories`, `from-minari`, `to-minari`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from socialiq.cli.output import Printing
from socialiq.datasets.columns import Bounds
from socialiq.datasets.minari import id_of, read_minari, write_minari
from socialiq.datasets.step_files import format_of, read_steps, write_steps
from socialiq.datasets.trajectories import read_trajectories
from socialiq.demonstrations import files
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.outputs import refuse_existing
from socialiq.social.angle import check_angle


@dataclass(frozen=True, kw_only=True)
class _Reader(Printing):
    """Base of commands that read a data set as demonstrations."""

    out: Path
    """Demonstrations file to write; must not exist."""
    social: str = ""
    """none: a reward of one number a step is r_env, and r_social is 0."""
    flatten: bool = False
    """Flatten observations of more axes (images) to one."""
    action_low: tuple[float, ...] = ()
    """Lower ends of continuous actions in the file's units, one for each number or one for all; by
    default actions are in [-1, 1], or those of a Minari data set's own space."""
    action_high: tuple[float, ...] = ()
    """Their upper ends."""

    def run(self) -> int:
        """Read, check, write, print the counts."""
        bounds = Bounds.of(self.action_low, self.action_high)
        refuse_existing(self.out)
        table = self.read(bounds=bounds, social=self.social, flatten=self.flatten)
        sha256 = files.save(self.out, table, replace=False)
        return show_counts(self, sha256, table)

    def read(self, **options: Any) -> Demonstrations:
        """Return the demonstrations, of options that every reader has."""
        raise NotImplementedError


@dataclass(frozen=True)
class FromArrays(_Reader):
    """Read plain arrays (.npz, .csv, .parquet, .hdf5), one row for each step, as demonstrations.

    Example: socialiq data from-arrays steps.csv --n-actions 3 --out mine.safetensors
    """

    file: Annotated[Path, tyro.conf.Positional]
    """Archive (.npz) or table (.csv, .parquet) with observation, action, rewards, ...; or a file in
    D4RL's layout (.hdf5)."""
    n_actions: int = 0
    """Number of actions of the world, 0 for continuous ones. A file of `socialiq data to-arrays`
    has it, except CSV."""
    mode: tuple[str, ...] = ()
    """Names of the demonstrators that the column `mode` numbers; by default demonstrator."""

    def read(self, **options: Any) -> Demonstrations:
        """Read the file."""
        return read_steps(self.file, n_actions=self.n_actions, mode_names=self.mode, **options)


@dataclass(frozen=True)
class ToArrays(Printing):
    """Write demonstrations as plain arrays (.npz, .csv, .parquet, .hdf5), one row for each step.

    Example: socialiq data to-arrays mixed.safetensors --out mixed.parquet
    """

    file: Annotated[Path, tyro.conf.Positional]
    """Demonstrations file."""
    out: Path
    """File to write; its ending names the format. Must not exist."""

    def run(self) -> int:
        """Read, write, print the counts."""
        format_of(self.out)
        refuse_existing(self.out)
        table = files.load(self.file, continuous=True)
        write_steps(self.out, table, replace=False)
        return show_counts(self, files.sha256_of(table), table)


@dataclass(frozen=True)
class FromTrajectories(_Reader):
    """Read trajectories under the imitation library's names, from .npz, .csv or .parquet.

    Pickled infos of an archive are not read.

    Example: socialiq data from-trajectories rollouts.npz --n-actions 3 --out mine.safetensors
    """

    file: Annotated[Path, tyro.conf.Positional]
    """Archive (.npz) with obs, acts, rews, terminal, indices; or a table (.csv, .parquet) with
    obs_0, ..., acts, next_obs_0, ..., rews, terminal, trajectory."""
    n_actions: int = 0
    """Number of actions of the world; 0 for continuous ones."""
    mode: str = "demonstrator"
    """Name of the demonstrator."""
    time_limit: int = 0
    """Steps after which the clock cut an episode that the archive calls terminal; 0 for none."""

    def read(self, **options: Any) -> Demonstrations:
        """Read the file."""
        options |= {"n_actions": self.n_actions, "time_limit": self.time_limit}
        return read_trajectories(self.file, mode=self.mode, **options)


@dataclass(frozen=True)
class ToMinari(Printing):
    """Write demonstrations as a Minari data set (HDF5), the reward pair in its infos.

    Example: socialiq data to-minari mixed.safetensors --out crossing7-v0
    """

    file: Annotated[Path, tyro.conf.Positional]
    """Demonstrations file."""
    out: Path
    """Folder to make; Minari's own root is not used."""
    id: str = ""
    """Minari's name of the data set, NAME-v0; by default the folder's."""
    angle: float = 0.0
    """Social angle in degrees of the scalar reward that Minari stores beside the pair."""

    def run(self) -> int:
        """Read, write, print the place."""
        check_angle(self.angle)
        table = files.load(self.file, continuous=True)
        name = self.id or id_of(self.out)
        folder = write_minari(table, self.out, dataset_id=name, angle=self.angle)
        written = {"folder": str(folder), "id": name, "episodes": table.n_episodes}
        return self.show(written | {"sha256": files.sha256_of(table)}, [written])


@dataclass(frozen=True)
class FromMinari(_Reader):
    """Read a Minari data set (HDF5) as demonstrations; no environment is made.

    Example: socialiq data from-minari crossing7-v0 --out mixed.safetensors
    """

    folder: Annotated[Path, tyro.conf.Positional]
    """Folder of the data set."""
    mode: str = "demonstrator"
    """Name of the demonstrator, where the data set names none."""

    def read(self, **options: Any) -> Demonstrations:
        """Read the folder."""
        return read_minari(self.folder, mode=self.mode, **options)


def show_counts(command: Any, sha256: str, table: Demonstrations) -> int:
    """Print the numbers of episodes and transitions in a command's file; return the status 0."""
    counts = [
        {"mode": mode, "episodes": episodes, "transitions": transitions}
        for mode, (episodes, transitions) in table.counts().items()
    ]
    result = {"file": str(command.out), "sha256": sha256, "modes": counts}
    return command.show(result, counts, f"{command.out}")
