"""The page's HTML for a file of the user's: the same styles, core and scripts as the dial's."""

from __future__ import annotations

import html
import re
from pathlib import Path
from typing import NamedTuple

from socialiq.page.bundle import ASSETS, program
from socialiq.page.content import content, core
from socialiq.page.shown_dial import shipped_dial
from socialiq.page.write import embedded, policy
from socialiq.view.shown import Shown

OWN = Path(__file__).with_name("assets")


class Front(NamedTuple):
    """A page and its content security policy.

    Attributes:
        text: HTML.
        policy: Its own script, its styles, its server; nothing else, and in no frame.
    """

    text: str
    policy: str


def front(shown: Shown, socket_address: str) -> Front:
    """Return the page that shows something.

    Args:
        shown: Content of the page; its texts may hold anything.
        socket_address: Address of the websocket.

    Raises:
        UserError: If the package was installed without the committed results.
    """
    script = program("opened", OWN)
    style = (ASSETS / "style.css").read_text(encoding="utf-8") + _asset("opened.css")
    about = {"kind": shown.kind, "count": shown.count, **shown.data}
    blocks = {
        "style": style,
        "title": html.escape(shown.title),
        "lead": html.escape(shown.lead),
        "body": _asset(f"{shown.kind}.html").replace("{controls}", _asset("controls.html")),
        "data": embedded({**content(shipped_dial()), **core(shown.options), "shown": about}),
        "program": script,
    }
    text = re.sub(r"\{(\w+)\}", lambda match: blocks[match[1]], _asset("opened.html"))
    allowed = policy(script, style, f"'self' {socket_address}")
    return Front(text, f"{allowed}; frame-ancestors 'none'")


def _asset(name: str) -> str:
    return (OWN / name).read_text(encoding="utf-8")
