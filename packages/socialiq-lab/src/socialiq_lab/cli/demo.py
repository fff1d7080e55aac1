"""`demo`: the first thing to try, in a minute or two."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from socialiq import results_folder as store
from socialiq.cli.drivers import driver_of
from socialiq.cli.output import Display, Printing, print_json, print_table
from socialiq.evaluation.episodes import episodes_of, outcome_row
from socialiq.learners.settings import check_seeds
from socialiq.types import Row
from socialiq.worlds.highway.render import episode_scenes
from socialiq.worlds.highway.sheet import save as film
from socialiq.worlds.intersection import atlas
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Intersection
from socialiq_lab import study as experiment
from socialiq_lab.registry import find

FILMED = "prosocial"
DRIVEN = ("baseline", "egoistic", FILMED, "altruistic", "expert_egoistic", "set_egoistic")
RULES = ("gap_3s", "go")
"""Drivers of the last table: of the atlas, as far as it came with the package, and by rule."""


@dataclass(frozen=True)
class Demo(Printing):
    """Train the 7x7 baseline and three targets, then drive the intersection with the atlas.

    Example: socialiq demo
    """

    out: Path = Path("demo")
    """Folder for the tables and figures; an earlier demo there is replaced."""
    seeds: tuple[int, ...] = (0, 1, 2, 3, 4)
    """Training seeds."""
    episodes: int = 200
    """Episodes of each policy at the intersection."""

    def drive(self) -> list[Row]:
        """Outcomes of the atlas' learners, its best egoist and a rule; and a film of one."""
        with Display() as display:
            display.stage("intersection: compiling, the first time only")
            world = Intersection(Options())
            batch = world.batch(self.episodes)
            rows = []
            drivers = [name for name in DRIVEN if name in atlas.names()] + [*RULES]
            for name in drivers:
                episodes = episodes_of(batch, driver_of(name), np.arange(self.episodes))
                row = outcome_row(episodes)
                columns = ("collision", "arrival", "timeout", "speed_kmh", "stopped")
                rows.append({"policy": name} | {key: row[key] for key in columns})
            filmed = FILMED if FILMED in drivers else RULES[0]
            scenes = episode_scenes(world.batch(1, traced=True), driver_of(filmed), seed=3)
            rate = world.options.simulation_frequency
            film(self.out / "intersection.gif", scenes, world.view, rate)
        return rows

    def run(self) -> int:
        """Run the small grid study, print the table, name the next pages."""
        check_seeds(self.seeds)
        store.check_target(self.out, replace=True)
        study = find("grid")
        config = study.Config(
            seeds=self.seeds, target_kinds=("running",), strengths=(2.0,), comparisons=False
        )
        with Display() as display:
            results = experiment.run(study, config, display.stage)
        experiment.save(study, results, self.out, replace=True)
        rows = study.view(results)[0].rows
        driven = self.drive()
        if self.json:
            print_json({"table": rows, "intersection": driven, "out": str(self.out)})
            return 0
        print_table(rows, f"7x7: angle in degrees, greedy, {len(self.seeds)} seeds, exact")
        print(
            f"\nThe pictures are in {self.out}/: tradeoff.png first, then fig_6_2_ring.png.\n"
            "The optimum for 45 degrees itself is at 10.0 degrees: an angle of 39 would be a\n"
            "deviation, so read the regret column (0 is optimal), not the angle's distance.\n"
        )
        print_table(driven, f"intersection: shares, km/h; {self.episodes} episodes each")
        print(
            f"\n{self.out}/intersection.gif shows an episode.\n"
            "Next: socialiq claims (what of the thesis holds), docs/reproduction/grid.md (why),\n"
            "socialiq train iq-learn --help (your own angle)."
        )
        return 0
