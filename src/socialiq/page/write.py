"""The page as one file: styles, program and data inside it, and a policy that forbids all else."""

from __future__ import annotations

import base64
import hashlib
import json
from pathlib import Path

from socialiq.page.bundle import ASSETS, program
from socialiq.page.content import about, content
from socialiq.storage import write_atomically

FILE = "index.html"


def page() -> str:
    """Return the page's HTML. It makes no request; its program and its styles are named by hash."""
    style = (ASSETS / "style.css").read_text(encoding="utf-8")
    script = program()
    policy = "; ".join(
        [
            "default-src 'none'",
            f"script-src {_hash(script)} 'wasm-unsafe-eval'",
            f"style-src {_hash(style)}",
            "worker-src blob:",
            "base-uri 'none'",
            "form-action 'none'",
        ]
    )
    # No text of the data can end its element.
    data = json.dumps(content(), separators=(",", ":")).replace("<", "\\u003c")
    parts = {"policy": policy, "style": style, "about": about(), "data": data, "program": script}
    text = (ASSETS / "index.html").read_text(encoding="utf-8")
    for name, part in parts.items():
        text = text.replace(f"{{{name}}}", part)
    return text


def write_page(folder: Path) -> Path:
    """Write the page into a folder and return its path.

    Raises:
        UserError: If it can't be written, or the committed results did not come with the package.
    """
    path = folder / FILE
    write_atomically(path, page(), replace=False)
    return path


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
