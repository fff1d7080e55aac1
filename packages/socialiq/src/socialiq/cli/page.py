"""`page` and `view`: the dial in a browser as one file, and the user's own files over a server."""

from __future__ import annotations

import dataclasses
import webbrowser
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from socialiq.cli.audit import CodeOptions
from socialiq.cli.drivers import refuse_misfit
from socialiq.cli.output import say
from socialiq.nn.dial_policy import DialPolicy
from socialiq.outputs import new_folder, refuse_existing
from socialiq.social.angle import check_angle
from socialiq.worlds.intersection.world import Intersection


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
        from socialiq.page.write import FILE, write_page

        refuse_existing(self.out / FILE)
        dial = None
        if self.dial:
            refuse_misfit(str(self.dial), DialPolicy.load(self.dial), Intersection())
            dial = own_dial(self.dial)
        say(f"open {write_page(new_folder(self.out), dial)}")
        return 0


@dataclass(frozen=True)
class View:
    """Open the page in a browser for a policy, an audit or data of yours.

    A policy (a file of socialiq, .zip of Stable-Baselines3, .onnx, "process:COMMAND LINE",
    python:MODULE:ATTRIBUTE, atlas:NAME or a rule-based driver) drives beside the dial on the same
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
    port: int = 0
    """Port at 127.0.0.1; 0 takes a free one."""
    open: bool = True
    """Print the address instead of opening a browser."""
    code: tyro.conf.OmitArgPrefixes[CodeOptions] = dataclasses.field(default_factory=CodeOptions)

    def run(self) -> int:
        """Serve until Ctrl-C."""
        from socialiq.view.open import opened
        from socialiq.view.server import check_extra, serve

        if self.angle is not None:
            check_angle(self.angle)
        check_extra()
        content = opened(self.what, self.angle, self.code.trust) if self.what else None

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
