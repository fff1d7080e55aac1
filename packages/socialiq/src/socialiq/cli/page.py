"""`page`: the dial in a browser, as one file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from socialiq.cli.drivers import refuse_misfit
from socialiq.cli.output import say
from socialiq.nn.dial_policy import DialPolicy
from socialiq.outputs import new_folder, refuse_existing
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
        from socialiq.page.dial import own_dial
        from socialiq.page.write import FILE, write_page

        refuse_existing(self.out / FILE)
        dial = None
        if self.dial:
            refuse_misfit(str(self.dial), DialPolicy.load(self.dial), Intersection())
            dial = own_dial(self.dial)
        say(f"open {write_page(new_folder(self.out), dial)}")
        return 0
