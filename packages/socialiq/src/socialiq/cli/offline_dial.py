"""`train-dial` with an offline preset: a dial of any world, from a file of demonstrations alone.

At a recorded junction a dial may practise too (`experiments.recorded_practice`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.cli.options import overridden
from socialiq.cli.output import print_json, print_table
from socialiq.cli.progress import Display
from socialiq.cli.run_folder import CHUNK, described_file
from socialiq.demonstrations import files
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.kernel import Trained
from socialiq.learners.offline.config import Hyperparameters, Preset, StaticConfig
from socialiq.learners.offline.train import train
from socialiq.outputs import new_folder, whole_folder
from socialiq.results_folder import as_csv, versions
from socialiq.storage import kind_of, write_atomically, write_json
from socialiq.to_json import rounded
from socialiq.types import Row
from socialiq.worlds import WORLD_FILE
from socialiq.worlds.grid_world import GridWorld
from socialiq.worlds.highway.scenes import SCENES
from socialiq.worlds.highway.world import world_of
from socialiq.worlds.registry import make
from socialiq_lab.gridworld_runs import seen
from socialiq_lab.recorded_practice import Practice, train_with_practice
from socialiq_recordings.world.recorded_world import RecordedWorld


@dataclasses.dataclass(frozen=True)
class OfflineCommand:
    """A call of `train-dial` with an offline preset.

    Attributes:
        world: Name of the world that the demonstrations come from.
        data: Their file.
        preset: Name and content of the preset.
        seeds: Training seeds, a dial each.
        static: Options laid over the preset's structure.
        numbers: Options laid over its numbers.
        practice: Practice at a recorded junction.
        out: Folder to make.
        as_json: Whether to print one JSON object.
    """

    world: str
    data: Path
    preset: tuple[str, Preset]
    seeds: Sequence[int]
    static: Any
    numbers: Any
    practice: Practice
    out: Path
    as_json: bool

    def run(self) -> int:
        """Train a dial for each seed, write the folder, print what came out."""
        _, preset = self.preset
        if self.practice.rounds and kind_of(Path(self.world)) != WORLD_FILE:
            raise UserError(
                f"--practice is at a recorded junction, a file of `socialiq data world`: in "
                f"{self.world} leave it out, or take an online preset"
            )
        data = files.load(self.data)
        structure = dataclasses.replace(preset.structure, **encoding_of(self.world, data))
        static = overridden(structure, self.static)
        chosen = overridden(preset.numbers, self.numbers)
        numbers = [dataclasses.replace(chosen, seed=seed) for seed in self.seeds]
        new_folder(self.out).rmdir()  # refused now if it has content or can't be made
        with whole_folder(self.out) as folder:
            dials = self.write(folder, static, numbers, data)
        if self.as_json:
            print_json({"out": str(self.out), "dials": dials})
        else:
            print_table(dials)
        return 0

    def write(
        self,
        folder: Path,
        static: StaticConfig,
        numbers: Sequence[Hyperparameters],
        data: Demonstrations,
    ) -> list[Row]:
        """Train, fill the folder with dials and their record; return the dials' entries."""
        name, _ = self.preset
        dials: list[Row] = []
        metrics: list[Row] = []
        for number, one in enumerate(numbers):
            with Display() as display:
                stages = self.train(number, static, one, data, display)
            file = f"dial_{number}.safetensors"
            sha256 = stages["dial"].policy(0).save(folder / file)
            dials.append({"file": file, "seed": one.seed, "sha256": sha256})
            metrics += _losses(stages, one.seed)
        write_atomically(folder / "metrics.csv", as_csv(metrics))
        record = {
            "structure": dataclasses.asdict(static),
            "numbers": [dataclasses.asdict(one) for one in numbers],
            "preset": name,
            "world": self.world,
            "data": described_file(self.data),
            "practice": dataclasses.asdict(self.practice) if self.practice.rounds else None,
            "versions": versions(),
            "dials": dials,
        }
        write_json(folder / "run.json", rounded(record))
        return dials

    def train(
        self,
        number: int,
        static: StaticConfig,
        numbers: Hyperparameters,
        data: Demonstrations,
        display: Display,
    ) -> dict[str, Trained]:
        """Train one dial; return the outcome of each stage of its last training."""
        if not self.practice.rounds:
            return train(static, numbers, data, _progress(display), CHUNK)

        def progress(practised: int, stage: str) -> Callbacks:
            name = f"{stage}, {practised} of {self.practice.rounds} rounds practised"
            return Callbacks(on_report=display.stage(name))

        first = self.practice.first_seed + number * self.practice.span
        practice = dataclasses.replace(self.practice, first_seed=first)
        world = RecordedWorld.load(Path(self.world))
        found = train_with_practice(world, static, [numbers], data, practice, progress, CHUNK)
        return found.stages


def encoding_of(world: str, data: Demonstrations) -> dict[str, Any]:
    """Return what a world determines of the static config: encoding, length of an episode.

    Raises:
        UserError: If there is no such world, or the demonstrations come from another.
    """
    if kind_of(Path(world)) == WORLD_FILE:
        made: Any = RecordedWorld.load(Path(world))
    else:
        made = world_of(world) if world in SCENES else make(world)
    clocked = made.with_clock() if isinstance(made, GridWorld) else made
    known = [(one.n_features, one.n_actions) for one in (made, clocked)]
    given = (data.n_features, data.n_actions)
    if given not in known:
        raise UserError(
            f"the demonstrations have {given[0]} features and {given[1]} actions, {world} has "
            f"{known[0][0]} and {known[0][1]}: they belong to another world"
        )
    if isinstance(made, RecordedWorld):
        # A recorded vehicle leaves the view before its episode is over.
        return {"whole_episode": made.config.decisions}
    if not isinstance(made, GridWorld):
        return {}
    return {"view": "flat", "one_hot": seen(made if given == known[0] else clocked)}


def _progress(display: Display) -> Callable[[str], Callbacks]:
    """Return callbacks that show each stage's progress."""
    return lambda stage: Callbacks(on_report=display.stage(stage))


def _losses(stages: dict[str, Trained], seed: int) -> list[Row]:
    """Return the mean loss of each chunk of each stage."""
    return [
        {"seed": seed, "stage": stage, "updates": updates, "loss": rounded(float(loss))}
        for stage, trained in stages.items()
        for updates, loss in zip(
            trained.history.updates,
            np.asarray(trained.history.array("loss"))[:, 0],
            strict=True,
        )
    ]
