"""`train practised-dial`: dials that also practise in the recorded junction."""

import dataclasses
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import Any

from socialiq.cli.output import Display, Policies
from socialiq.cli.train.dial import OfflineDial
from socialiq.cli.train.shared import CHUNK
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.kernel import Trained
from socialiq.types import Row
from socialiq_recordings.world.practice import Practice, train_with_practice
from socialiq_recordings.world.recorded_world import RecordedWorld


@dataclass(frozen=True)
class PractisedDial(OfflineDial):
    """Train a dial of a recorded junction that also practises there.

    In each round it drives episodes at seven angles, one decision in ten drawn at random, and a new
    dial learns from the demonstrations and all practice so far.

    Example: socialiq train practised-dial human.safetensors --world world.safetensors --out dial
    """

    _: KW_ONLY
    rounds: int = 5
    """Rounds of practice; 0 for none."""
    episodes: int = 100
    """Episodes of a round at each of the angles."""
    first_seed: int = 65_000_000
    """Seed of the first of these episodes."""

    @property
    def practice(self) -> Practice:
        """Amount of practice."""
        return Practice(self.rounds, self.episodes, first_seed=self.first_seed)

    def result(self) -> Policies:
        """Train a dial for each seed, write the folder."""
        assert self.practice.span >= 0  # sizes that make no practice are refused at once
        if not self.world:
            raise UserError(
                "no junction to practise in: add --world FILE, of `socialiq data world`"
            )
        RecordedWorld.load(Path(self.world))
        return super().result()

    def practised(self) -> Row | None:
        """Return the record of practice."""
        return dataclasses.asdict(self.practice) if self.rounds else None

    def stages(
        self, number: int, static: Any, numbers: Any, data: Demonstrations, display: Display
    ) -> dict[str, Trained]:
        """Train one dial with practice; return the outcome of each stage of its last training.

        Args:
            number: Number of the dial, from 0; each dial practises on its own seeds.
            static: Structure of the dial, the same for all dials.
            numbers: Hyperparameters and seed of the dial.
            data: Demonstrations of the recorded drivers.
            display: Display of the progress.

        Returns:
            Outcomes by the name of the stage; "dial" is the trained dial.
        """
        if not self.rounds:
            return super().stages(number, static, numbers, data, display)

        def progress(practised: int, stage: str) -> Callbacks:
            name = f"{stage}, {practised} of {self.rounds} rounds practised"
            return Callbacks(on_report=display.stage(name))

        first = self.practice.first_seed + number * self.practice.span
        practice = dataclasses.replace(self.practice, first_seed=first)
        world = RecordedWorld.load(Path(self.world))
        return train_with_practice(world, static, [numbers], data, practice, progress, CHUNK).stages
