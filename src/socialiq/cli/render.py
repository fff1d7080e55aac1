"""`render`: a picture of a world, or of an episode in it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from socialiq.cli.drivers import driver_of
from socialiq.errors import UserError, one_of
from socialiq.evaluation.rollout import rollout_table
from socialiq.plotting.style import png
from socialiq.social.angle import check_angle
from socialiq.storage import write_atomically
from socialiq.worlds.enumerate import Table, tabulate
from socialiq.worlds.intersection.batch import Batch
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Intersection
from socialiq.worlds.pictures import filmstrip, picture
from socialiq.worlds.registry import make, make_grid
from socialiq.worlds.tabular_policy import expert_policy

FILMS = (".gif", ".mp4")


@dataclass(frozen=True)
class Render:
    """Draw a world's first state, or an episode: as a filmstrip, or as a film in the intersection.

    Example: socialiq render intersection --driver gap_3s --seed 3 --out episode.gif
    """

    world: Annotated[str, tyro.conf.Positional]
    """crossing5, crossing7 or intersection."""
    out: Path
    """PNG file to write; .gif or .mp4 for a film."""
    angle: float | None = None
    """In a gridworld: draw an episode of this angle's expert."""
    driver: str = ""
    """In the intersection: draw an episode of this reference driver or policy file."""
    seed: int = 0
    """Seed of the episode."""

    def run(self) -> int:
        """Draw and write."""
        if self.seed < 0:
            raise UserError(f"seed must be at least 0, got {self.seed}")
        world = make(self.world)
        suffixes = (".png", *FILMS) if isinstance(world, Intersection) else (".png",)
        one_of(f"kind of picture of {self.world}", self.out.suffix, suffixes)
        if isinstance(world, Intersection):
            self._check_unused("angle", self.angle is not None, "--driver")
            self.intersection(world.options)
            return 0
        self._check_unused("driver", bool(self.driver), "--angle")
        table = tabulate(make_grid(self.world))
        if self.angle is None:
            drawn = picture(table.world, table.world.start[0][0])
        else:
            drawn = filmstrip(table.world, _episode(table, check_angle(self.angle), self.seed))
        write_atomically(self.out, png({"picture": drawn})["picture"])
        return 0

    def _check_unused(self, option: str, given: bool, instead: str) -> None:
        if given:
            raise UserError(f"{self.world} has no --{option}: use {instead}")

    def intersection(self, options: Options) -> None:
        """Draw the first state, an episode's decisions, or a film of all its sub-steps."""
        from socialiq.worlds.intersection.pictures import render, scenes

        if not self.driver:
            if self.out.suffix in FILMS:
                raise UserError("a film needs an episode: add --driver")
            batch = Batch(options, 1)
            batch.reset([self.seed])
            drawn = render.picture(scenes.present_scene(batch))
            write_atomically(self.out, png({"picture": drawn})["picture"])
            return
        driver = driver_of(self.driver, self.seed, options)
        episode = scenes.episode_scenes(options, driver, self.seed)
        if self.out.suffix in FILMS:
            render.save(self.out, episode, options.simulation_frequency)
            return
        drawn = render.filmstrip(episode[:: options.frames])
        write_atomically(self.out, png({"picture": drawn})["picture"])


def _episode(table: Table, angle: float, seed: int) -> list[list[int]]:
    steps = rollout_table(table, expert_policy(table, angle), 1, seed).transitions
    states = np.vstack([steps.observation, steps.next_observation[-1:]])
    return states.astype(int).tolist()
