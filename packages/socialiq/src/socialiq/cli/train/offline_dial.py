"""`train offline-dial`: a dial of any world, from a file of demonstrations alone."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from socialiq.cli.output import Display, Printing
from socialiq.cli.train import shared
from socialiq.demonstrations import files
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.dial.config import OfflineDialConfig, OfflineDialHyperparameters
from socialiq.learners.dial.offline import train
from socialiq.learners.kernel import Trained
from socialiq.learners.settings import check_seeds
from socialiq.outputs import new_folder, whole_folder
from socialiq.results_folder import as_csv, versions
from socialiq.storage import write_atomically, write_json
from socialiq.to_json import rounded
from socialiq.types import Row
from socialiq.worlds.grid_world import GridWorld
from socialiq.worlds.registry import open_world

PRESET = "offline-regularised"
"""Settings to begin with."""


@dataclass(frozen=True)
class OfflineDial(Printing):
    """Train a dial of any world from demonstrations alone, regularised towards their drivers.

    Example: socialiq train offline-dial mixed.safetensors --world intersection --out run
    """

    data: shared.Data
    """Demonstrations file, of `socialiq collect` or `socialiq data world`."""
    _: KW_ONLY
    world: str
    """World of the demonstrations: crossing5, crossing7, intersection, merge, roundabout, or a file
    of `socialiq data world`."""
    out: Path
    """Folder to make: dials, metrics.csv, run.json."""
    seed: tuple[int, ...] = (0,)
    """Training seeds, a dial each."""
    size: shared.Size = field(default_factory=shared.SizeOptions)
    options: tyro.conf.OmitArgPrefixes[shared.SetOptions] = field(default_factory=shared.SetOptions)

    def run(self) -> int:
        """Train a dial for each seed, write the folder, print what came out."""
        check_seeds(self.seed)
        data = files.load(self.data)
        settings = encoding_of(self.world, data) | self.size.given()
        static, numbers = self.options.apply(
            (OfflineDialConfig(), OfflineDialHyperparameters()), settings
        )
        runs = [dataclasses.replace(numbers, seed=seed) for seed in self.seed]
        new_folder(self.out).rmdir()  # refused now if it has content or can't be made
        with whole_folder(self.out) as folder:
            dials = self.write(folder, static, runs, data)
        return self.show({"out": str(self.out), "dials": dials}, dials)

    def write(
        self, folder: Path, static: Any, runs: Sequence[Any], data: Demonstrations
    ) -> list[Row]:
        """Train, fill the folder with dials and their record; return the dials' entries."""
        dials: list[Row] = []
        metrics: list[Row] = []
        for number, numbers in enumerate(runs):
            with Display() as display:
                stages = self.stages(number, static, numbers, data, display)
            file = f"dial_{number}.safetensors"
            sha256 = stages["dial"].policy(0).save(folder / file)
            dials.append({"file": file, "seed": numbers.seed, "sha256": sha256})
            for stage, trained in stages.items():
                losses = np.asarray(trained.history.array("loss"))[:, 0]
                start = {"seed": numbers.seed, "stage": stage}
                metrics += [
                    start | {"updates": updates, "loss": rounded(float(loss))}
                    for updates, loss in zip(trained.history.updates, losses, strict=True)
                ]
        write_atomically(folder / "metrics.csv", as_csv(metrics))
        record = {
            "structure": dataclasses.asdict(static),
            "numbers": [dataclasses.asdict(numbers) for numbers in runs],
            "preset": PRESET,
            "world": self.world,
            "data": shared.described_file(self.data),
            "practice": self.practised(),
            "versions": versions(),
            "dials": dials,
        }
        write_json(folder / "run.json", rounded(record))
        return dials

    def practised(self) -> Row | None:
        """Return the record of practice in the world; None for a training without."""
        return None

    def stages(
        self, number: int, static: Any, numbers: Any, data: Demonstrations, display: Display
    ) -> dict[str, Trained]:
        """Train one dial; return the outcome of each stage of its training.

        Args:
            number: Of the dial, from 0.
            static: Its config.
            numbers: Its hyperparameters.
            data: The demonstrations.
            display: Shows the progress.
        """
        del number  # of use to trainings that practise

        def progress(stage: str) -> Callbacks:
            return Callbacks(on_report=display.stage(stage))

        return train(static, [numbers], [data], progress, shared.CHUNK)


def encoding_of(name: str, data: Demonstrations) -> dict[str, Any]:
    """Return what a world determines of the static config: encoding, length of an episode.

    Raises:
        UserError: If there is no such world, or the demonstrations come from another.
    """
    world, sizes = open_world(name), (data.n_features, data.n_actions)
    for view in (world, world.with_clock()):
        if (view.n_features, view.n_actions) == sizes:
            if isinstance(view, GridWorld):
                return {"view": "flat", "one_hot": view.one_hot}
            return {"whole_episode": view.whole_episode}
    raise UserError(
        f"the demonstrations have {sizes[0]} features and {sizes[1]} actions, {name} has "
        f"{world.n_features} and {world.n_actions}: they belong to another world"
    )
