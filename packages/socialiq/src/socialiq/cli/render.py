"""`render`: a picture of a world, or of an episode in it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from socialiq.cli.drivers import driver_on, road_named
from socialiq.errors import UserError, one_of
from socialiq.evaluation.rollout import rollout_table
from socialiq.plotting.style import png
from socialiq.social.angle import check_angle
from socialiq.storage import write_atomically
from socialiq.worlds.enumerate import expert_policy, tabulate
from socialiq.worlds.highway.scenes import SCENES
from socialiq.worlds.highway.world import SceneWorld
from socialiq.worlds.intersection.world import Intersection
from socialiq.worlds.pictures import filmstrip, picture
from socialiq.worlds.registry import GRIDWORLDS, INTERSECTIONS, make_grid

FILMS = (".gif", ".mp4")
WORLDS = (*GRIDWORLDS, *INTERSECTIONS, *SCENES)


@dataclass(frozen=True)
class Render:
    """Draw a world's first state, or an episode: as a filmstrip, or on a road as a film.

    Example: socialiq render intersection --driver gap_3s --seed 3 --out episode.gif
    """

    world: Annotated[str, tyro.conf.Positional]
    """crossing5, crossing7, intersection, intersection-continuous, intersection-continuous-steering
    (with -offroad: leaving the road ends an episode), merge or roundabout."""
    out: Path
    """PNG file to write; .gif or .mp4 for a film."""
    angle: float | None = None
    """In a gridworld: draw an episode of this angle's expert. On a road: angle of a dial."""
    driver: str = ""
    """On a road: draw an episode of this policy file; at the intersection a rule or a policy of the
    atlas too."""
    seed: int = 0
    """Seed of the episode."""

    def run(self) -> int:
        """Draw and write."""
        one_of("world", self.world, WORLDS)
        on_road = self.world not in GRIDWORLDS
        suffixes = (".png", *FILMS) if on_road else (".png",)
        one_of(f"kind of picture of {self.world}", self.out.suffix, suffixes)
        if self.angle is not None:
            check_angle(self.angle)
        if on_road:
            self.road(road_named(self.world))
            return 0
        if self.driver:
            raise UserError(f"{self.world} has no --driver: use --angle")
        table = tabulate(make_grid(self.world))
        if self.angle is None:
            figure = picture(table.world, table.world.start[0][0])
        else:
            policy = expert_policy(table, self.angle)
            steps = rollout_table(table, policy, 1, self.seed).transitions
            states = np.vstack([steps.observation, steps.next_observation[-1:]])
            figure = filmstrip(table.world, states.astype(int).tolist())
        write_atomically(self.out, png({"picture": figure})["picture"])
        return 0

    def road(self, world: Intersection | SceneWorld) -> None:
        """Draw the first state, an episode's decisions, or a film of all its sub-steps."""
        from socialiq.worlds.highway import render, sheet

        batch = world.batch(1, traced=True)
        if not self.driver:
            if self.out.suffix in FILMS:
                raise UserError("a film needs an episode: add --driver")
            if self.angle is not None:
                raise UserError(f"{self.world} has no --angle of its own: add --driver, a dial")
            batch.reset([self.seed])
            figure = sheet.picture(render.present_scene(batch), world.view)
        else:
            driver = driver_on(world, self.driver, self.angle, self.seed)
            episode = render.episode_scenes(batch, driver, self.seed)
            if self.out.suffix in FILMS:
                sheet.save(self.out, episode, world.view, world.options.simulation_frequency)
                return
            figure = render.filmstrip(episode[:: world.options.frames], world.view)
        write_atomically(self.out, png({"picture": figure})["picture"])
