"""`train driver`: one dial of two angles for every road."""

from dataclasses import KW_ONLY, dataclass, field, replace
from pathlib import Path

from socialiq.cli.output import Policies
from socialiq.cli.train import shared
from socialiq.cli.train.dial import finish_dials
from socialiq.driver_training import training
from socialiq.driver_training.mixture import world_of_seed
from socialiq.errors import UserError
from socialiq.evaluation.parts import check_processes
from socialiq.learners.settings import check_seeds
from socialiq.nn.class_dial import ClassDial
from socialiq.types import Row
from socialiq.worlds import grammar
from socialiq.worlds.highway.observation import ROUTE

UPDATES_OF_AN_HOUR = 16_000
"""Gradient steps that an hour of one core of 2026 allows, with the labels that they need."""

MOST_HOURS = 1000.0


@dataclass(frozen=True)
class Driver(shared.Training):
    """Train the driver: one dial of the social angle and the class angle for every road.

    It learns from no demonstrations: states that it visits on drawn roads are labelled by rollouts
    of every action in copies of the simulator. Every 200 updates draw new roads, traffic, people,
    faults and fleets.

    Example: socialiq train driver --hours 2 --out run
    """

    _: KW_ONLY
    out: Path
    """Folder to make: dials, metrics.csv, run.json."""
    hours: float = 1.0
    """Hours of one core; they stand for 16,000 updates each, whatever the machine, so a run gives
    the same dial everywhere."""
    start: Path | None = None
    """File of a driver that every run begins with: a second stage, with lower rates and without
    the regression at the beginning."""
    seed: tuple[int, ...] = (0,)
    """Training seeds, a dial each."""
    processes: int = 0
    """Processes that label states; 0: this one. The dial is the same."""
    options: shared.Run = field(default_factory=shared.RunOptions)

    def result(self) -> Policies:
        """Train and write the folder."""
        check_seeds(self.seed)
        check_processes(self.processes)
        if not 0 < self.hours <= MOST_HOURS:
            raise UserError(f"--hours {self.hours:g}: give more than 0, at most {MOST_HOURS:g}")
        settings: Row = {"updates": max(round(self.hours * UPDATES_OF_AN_HOUR), 1)}
        first = None if self.start is None else ClassDial.load(self.start)
        numbers = training.NUMBERS if first is None else training.SECOND_STAGE
        static, numbers = self.options.apply((training.STRUCTURE, numbers), settings)
        if (static.view, static.classes, static.times) != ("set", True, 0):
            raise UserError(
                "the driver has both angles and no clock: leave out --set view, classes and times"
            )
        runs = [replace(numbers, seed=seed) for seed in self.seed]
        folder = shared.RunFolder(self.out, "dial", self.options, schema=ROUTE)
        with folder.callbacks([{"seed": seed} for seed in self.seed]) as callbacks:
            trained = training.train(static, runs, callbacks, first, self.processes)
        return finish_dials(folder, trained, {}, grammar.build(world_of_seed(0)))
