"""`page`: the dial in a browser, as one file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from socialiq.cli.output import say
from socialiq.outputs import new_folder


@dataclass(frozen=True)
class Page:
    """Write a page that turns the dial in a browser, without a server.

    It drives the intersection itself, at two or three angles on the same seed, and lets a person
    drive. One file: open it from the folder, or put it on any web server.

    Example: socialiq page --out dial-page
    """

    out: Path
    """New folder; it gets `index.html`."""

    def run(self) -> int:
        """Write."""
        from socialiq.page.write import write_page

        say(f"open {write_page(new_folder(self.out))}")
        return 0
