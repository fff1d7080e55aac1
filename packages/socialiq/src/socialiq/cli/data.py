"""`data from-arrays`, `to-arrays`, `from-trajectories`, `from-minari`, `to-minari`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from socialiq.cli.output import Printing, print_json, print_table
from socialiq.datasets.columns import Bounds
from socialiq.datasets.minari import id_of, read_minari, write_minari
from socialiq.datasets.step_files import format_of, read_steps, write_steps
from socialiq.datasets.trajectories import read_trajectories
from socialiq.demonstrations import files
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.outputs import refuse_existing
from socialiq.social.angle import check_angle


@dataclass(frozen=True)
class FromArrays(Printing):
    """Read plain arrays (.npz, .csv, .parquet, .hdf5), one row for each step, as demonstrations.

    Example: socialiq data from-arrays steps.csv --n-actions 3 --out mine.safetensors
    """

    file: Annotated[Path, tyro.conf.Positional]
    """Archive (.npz) or table (.csv, .parquet) with observation, action, rewards, ...; or a file in
    D4RL's layout (.hdf5)."""
    out: Path
    """Demonstrations file to write; must not exist."""
    n_actions: int = 0
    """Number of actions of the world, 0 for continuous ones. A file of `socialiq data to-arrays`
    has it, except CSV."""
    social: str = ""
    """none: a reward of one number a step is r_env, and r_social is 0."""
    mode: tuple[str, ...] = ()
    """Names of the demonstrators that the column `mode` numbers; by default demonstrator."""
    flatten: bool = False
    """Flatten observations of more axes (images) to one."""
    action_low: tuple[float, ...] = ()
    """Lower ends of continuous actions in the file's units, one for each number or one for all; by
    default actions are in [-1, 1]."""
    action_high: tuple[float, ...] = ()
    """Their upper ends."""

    def run(self) -> int:
        """Read, check, write, print the counts."""
        bounds = Bounds.of(self.action_low, self.action_high)

        def read() -> Demonstrations:
            return read_steps(
                self.file,
                n_actions=self.n_actions,
                bounds=bounds,
                mode_names=self.mode,
                social=self.social,
                flatten=self.flatten,
            )

        return save_new(self.out, read, self.json)


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
        _print_counts(self.out, files.sha256_of(table), table, self.json)
        return 0


@dataclass(frozen=True)
class FromTrajectories(Printing):
    """Read trajectories under the imitation library's names, from .npz, .csv or .parquet.

    Pickled infos of an archive are not read.

    Example: socialiq data from-trajectories rollouts.npz --n-actions 3 --out mine.safetensors
    """

    file: Annotated[Path, tyro.conf.Positional]
    """Archive (.npz) with obs, acts, rews, terminal, indices; or a table (.csv, .parquet) with
    obs_0, ..., acts, next_obs_0, ..., rews, terminal, trajectory."""
    out: Path
    """Demonstrations file to write; must not exist."""
    n_actions: int = 0
    """Number of actions of the world; 0 for continuous ones."""
    social: str = ""
    """none: a reward of one number a step is r_env, and r_social is 0."""
    mode: str = "demonstrator"
    """Name of the demonstrator."""
    time_limit: int = 0
    """Steps after which the clock cut an episode that the archive calls terminal; 0 for none."""
    flatten: bool = False
    """Flatten observations of more axes (images) to one."""
    action_low: tuple[float, ...] = ()
    """Lower ends of continuous actions in the file's units, one for each number or one for all; by
    default actions are in [-1, 1]."""
    action_high: tuple[float, ...] = ()
    """Their upper ends."""

    def run(self) -> int:
        """Read, check, write, print the counts."""
        bounds = Bounds.of(self.action_low, self.action_high)

        def read() -> Demonstrations:
            return read_trajectories(
                self.file,
                n_actions=self.n_actions,
                bounds=bounds,
                mode=self.mode,
                social=self.social,
                time_limit=self.time_limit,
                flatten=self.flatten,
            )

        return save_new(self.out, read, self.json)


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
        sha256 = files.sha256_of(table)
        written = {
            "folder": str(folder),
            "id": name,
            "episodes": table.n_episodes,
            "sha256": sha256,
        }
        if self.json:
            print_json(written)
        else:
            print_table([{k: v for k, v in written.items() if k != "sha256"}])
        return 0


@dataclass(frozen=True)
class FromMinari(Printing):
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
    """Flatten observations of more axes (images) to one."""
    action_low: tuple[float, ...] = ()
    """Lower ends of continuous actions in their units, one for each number or one for all; by
    default those of the data set's own space."""
    action_high: tuple[float, ...] = ()
    """Their upper ends."""

    def run(self) -> int:
        """Read, check, write, print the counts."""
        bounds = Bounds.of(self.action_low, self.action_high)

        def read() -> Demonstrations:
            return read_minari(
                self.folder,
                social=self.social,
                mode=self.mode,
                flatten=self.flatten,
                bounds=bounds,
            )

        return save_new(self.out, read, self.json)


def save_new(out: Path, read: Callable[[], Demonstrations], as_json: bool) -> int:
    """Write what was read to a new file and print the counts; return the exit status.

    Raises:
        UserError: If the file exists, or nothing can be read.
    """
    refuse_existing(out)
    table = read()
    _print_counts(out, files.save(out, table, replace=False), table, as_json)
    return 0


def _print_counts(out: Path, sha256: str, table: Demonstrations, as_json: bool) -> None:
    counts = [
        {"mode": mode, "episodes": episodes, "transitions": transitions}
        for mode, (episodes, transitions) in table.counts().items()
    ]
    if as_json:
        print_json({"file": str(out), "sha256": sha256, "modes": counts})
    else:
        print_table(counts, f"{out}")
