"""The page as one file: styles, program and data inside it, and a policy that forbids all else."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from socialiq.page.bundle import ASSETS, program
from socialiq.page.content import about, content
from socialiq.page.shown_dial import ShownDial, shipped_dial
from socialiq.storage import write_atomically

FILE = "index.html"


def page(dial: ShownDial | None = None) -> str:
    """Return the page's HTML. It makes no request; its program and its styles are named by hash.

    Args:
        dial: The dial that is turned; by default the shipped one.
    """
    dial = dial or shipped_dial()
    style, script = (ASSETS / "style.css").read_text(encoding="utf-8"), program()
    blocks = {
        "policy": policy(script, style),
        "style": style,
        "about": about(dial),
        "data": embedded(content(dial)),
        "program": script,
    }
    text = (ASSETS / "index.html").read_text(encoding="utf-8")
    for name, block in blocks.items():
        text = text.replace(f"{{{name}}}", block)
    return text


def policy(script: str, style: str, connect: str = "") -> str:
    """Return a content security policy that allows one program with its worker, and one style.

    Args:
        script: Text of the program, which may compile WebAssembly.
        style: Text of the style sheet.
        connect: Sources that the program may connect to; none by default.
    """
    return "; ".join(
        [
            "default-src 'none'",
            f"script-src {source_hash(script)} 'wasm-unsafe-eval'",
            f"style-src {source_hash(style)}",
            "worker-src blob:",
            *([f"connect-src {connect}"] if connect else []),
            "base-uri 'none'",
            "form-action 'none'",
        ]
    )


def source_hash(text: str) -> str:
    """Return the source expression of an inline script or style in a content security policy."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def embedded(data: Mapping[str, Any]) -> str:
    """Return data as JSON that no text in it can end: for a `<script type="application/json">`."""
    return json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")


def write_page(folder: Path, dial: ShownDial | None = None) -> Path:
    """Write the page into a folder and return its path.

    Args:
        folder: The folder.
        dial: The dial that is turned; by default the shipped one.

    Raises:
        UserError: If it can't be written, or the committed results did not come with the package.
    """
    path = folder / FILE
    write_atomically(path, page(dial), replace=False)
    return path
