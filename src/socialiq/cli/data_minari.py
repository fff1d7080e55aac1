"""`data to-minari` and `data from-minari`: demonstrations as Minari data sets, out and in."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from socialiq.cli.data_arrays import save_new
from socialiq.cli.output import print_json, print_table
from socialiq.datasets.minari_read import read_minari
from socialiq.datasets.minari_write import id_of, write_minari
from socialiq.demonstrations import files
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.social.angle import check_angle


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
