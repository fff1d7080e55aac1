"""`render`: pictures of a world; `page` and `view`: the dial in a browser, also over a server."""

import webbrowser
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from socialiq.cli.audit import CodeOptions
from socialiq.cli.drivers import driver_of, refuse_misfit, with_one_ego
from socialiq.cli.output import say
from socialiq.errors import UserError, one_of
from socialiq.evaluation.rollout import rollout_table
from socialiq.foreign import drawing, one_line
from socialiq.nn.dial_policy import DialPolicy
from socialiq.outputs import all_or_none, new_folder
from socialiq.plotting.style import png
from socialiq.policies.drivers import world_for
from socialiq.social.angle import check_angle
from socialiq.storage import write_atomically
from socialiq.worlds import catalogue, grammar, pictures, registry
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.tabular_policy import expert_policy

FILMS = (".gif", ".mp4")


@dataclass(frozen=True)
class Render:
    """Draw a world's first state, or an episode: as a filmstrip, or on a road as a film.

    Example: socialiq render intersection --driver gap_3s --seed 3 --out episode.gif
    """

    world: Annotated[str, tyro.conf.Positional]
    """crossing5, crossing7, crosswalk7, intersection, intersection-continuous,
    intersection-continuous-steering (with -offroad: leaving the road ends an episode), merge or
    roundabout."""
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
        written = grammar.parse(world_for(self.world, [self.driver]))
        one_of("world", written.name, catalogue.NAMES)
        on_road = written.name in catalogue.ROADS
        suffixes = (".png", *FILMS) if on_road else (".png",)
        one_of(f"kind of picture of {self.world}", self.out.suffix, suffixes)
        if self.angle is not None:
            check_angle(self.angle)
        drawing()  # a missing library is told before an episode is driven
        if on_road:
            self.road(with_one_ego(written))
            return 0
        if self.driver:
            raise UserError(f"{self.world} has no --driver: use --angle")
        table = tabulate(registry.make_grid(self.world))
        if self.angle is None:
            figure = pictures.picture(table.world, table.world.start[0][0])
        else:
            policy = expert_policy(table, self.angle)
            steps = rollout_table(table, policy, 1, self.seed).transitions
            states = np.vstack([steps.observation, steps.next_observation[-1:]])
            figure = pictures.filmstrip(table.world, states.astype(int).tolist())
        write_atomically(self.out, png({"picture": figure})["picture"])
        return 0

    def road(self, world: Any) -> None:
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
            with driver_of(self.driver, world, self.angle, seed=self.seed) as loaded:
                if self.angle is not None and not loaded.record.kind.endswith("dial"):
                    raise UserError(
                        f"--angle is of a dial, which {one_line(self.driver)} is not: leave it out"
                    )
                episode = render.episode_scenes(batch, loaded.policy, self.seed)
            if self.out.suffix in FILMS:
                sheet.save(self.out, episode, world.view, world.options.simulation_frequency)
                return
            figure = render.filmstrip(episode[:: world.options.frames], world.view)
        write_atomically(self.out, png({"picture": figure})["picture"])


@dataclass(frozen=True)
class Page:
    """Write a page that turns the dial in a browser, without a server.

    It drives the intersection itself, at two or three angles on the same seed, and lets a person
    drive. One file: open it from the folder, or put it on any web server.

    Example: socialiq page --out dial-page
    """

    out: Path
    """New folder; it gets `index.html`."""
    dial: Path | None = None
    """Dial file of the intersection that the page turns, in the place of the shipped one. Its
    trade-off curve is measured first, by 500 episodes at every fifth degree."""

    def run(self) -> int:
        """Write."""
        from socialiq.page.data import own_dial
        from socialiq.page.write import write_page

        with all_or_none(new_folder(self.out)):
            dial = None
            if self.dial:
                refuse_misfit(str(self.dial), DialPolicy.load(self.dial), grammar.road_of())
                dial = own_dial(self.dial)
            say(f"open {write_page(self.out, dial)}")
        return 0


@dataclass(frozen=True)
class View:
    """Open the page in a browser for a policy, an audit or data of yours.

    A policy (a file of socialiq, .zip of Stable-Baselines3, .onnx, "process:COMMAND LINE",
    python:FILE.py:NAME, atlas:NAME or a rule-based driver) drives beside the dial on the same
    seeds. Demonstrations of the intersection and episodes of an audit are replayed. Recorded
    traffic (CommonRoad, or a file of `socialiq data import`) plays on its lanes, with its
    conflicts. Without a name, it is the page of `socialiq page`.

    The server listens at 127.0.0.1 alone, and answers only whom it gave the address, until Ctrl-C.

    Example: socialiq view policy.onnx
    """

    what: Annotated[str, tyro.conf.Positional] = ""
    """The policy, the folder of an audit, or the file of demonstrations or of recorded traffic."""
    angle: float | None = None
    """Angle in degrees at which a dial begins; by default 45."""
    world: str = "intersection"
    """World of a policy: in another one than the intersection (a gridworld, with crosswalks,
    continuous actions, merge, roundabout, or a file of `socialiq data world`) eight episodes of it
    are shown."""
    port: int = 0
    """Port at 127.0.0.1; 0 takes a free one."""
    open: bool = True
    """Print the address instead of opening a browser."""
    code: tyro.conf.OmitArgPrefixes[CodeOptions] = field(default_factory=CodeOptions)

    def run(self) -> int:
        """Serve until Ctrl-C."""
        from socialiq.view.open import opened
        from socialiq.view.server import check_extra, serve

        if self.angle is not None:
            check_angle(self.angle)
        check_extra()
        if self.world != "intersection" and not self.what:
            raise UserError("--world is of a policy: name one")
        of = (self.angle, self.code.trust, self.world)
        content = opened(self.what, *of) if self.what else None

        def show(address: str) -> None:
            say(f"{address}\nCtrl-C ends it")
            if self.open:
                webbrowser.open(address)

        try:
            serve(content, self.port, show)
        finally:
            if content is not None:
                content.close()
        say("stopped")
        return 0
