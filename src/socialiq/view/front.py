"""The page's HTML for something of the user's: the same styles, core and scripts as the dial's."""

from __future__ import annotations

import base64
import hashlib
import html
import json
import re
from pathlib import Path

from socialiq.page.bundle import ASSETS, program
from socialiq.page.content import content
from socialiq.view.shown import Shown

OWN = Path(__file__).with_name("assets")
_START = OWN / "opened.js"
_INLINE = re.compile(r"<(script|style)(?: id=\"program\")?>(.*?)</\1>", re.DOTALL)


def front(shown: Shown) -> str:
    """Return the page that shows something.

    Args:
        shown: What is shown; its texts may be anybody's.

    Raises:
        UserError: If the package was installed without the committed results.
    """
    style = (ASSETS / "style.css").read_text(encoding="utf-8") + _asset("opened.css")
    # No text of the data can end its element.
    data = {**content(), "shown": {"kind": shown.kind, "count": shown.count, **shown.data}}
    parts = {
        "style": style,
        "title": html.escape(shown.title),
        "lead": html.escape(shown.lead),
        "body": _asset(f"{shown.kind}.html").replace("{controls}", _asset("controls.html")),
        "data": json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c"),
        "program": program(_START),
    }
    return re.sub(r"\{(\w+)\}", lambda found: parts[found[1]], _asset("opened.html"))


def content_policy(text: str, socket_address: str) -> str:
    """Return the content security policy of a page: its own script, its styles, its server.

    Args:
        text: The page's HTML.
        socket_address: Address of the websocket.
    """
    hashes = {kind: _hash(inside) for kind, inside in _INLINE.findall(text)}
    return "; ".join(
        [
            "default-src 'none'",
            f"script-src {hashes['script']} 'wasm-unsafe-eval'",
            f"style-src {hashes['style']}",
            f"connect-src 'self' {socket_address}",
            "base-uri 'none'",
            "form-action 'none'",
            "frame-ancestors 'none'",
        ]
    )


def _asset(name: str) -> str:
    return (OWN / name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
