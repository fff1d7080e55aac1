"""The page as one file: its scripts, its data, its content security policy."""

import base64
import hashlib
import html
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from socialiq.page.data import (
    PageDial,
    caused_dial,
    crossing,
    fleet_dial,
    late_shares,
    shipped_dial,
    story,
)
from socialiq.page.fleets import fleet_data
from socialiq.page.people import people_data
from socialiq.page.webassembly.layout import CORE, layout
from socialiq.storage import packaged_results, read_json, write_atomically
from socialiq.worlds.intersection.options import Options

ASSETS = Path(__file__).with_name("assets")
START = "page"
"""Script that starts the page."""

_IMPORT = re.compile(r'^import \{ ([^}]+) \} from "((?:\.\.?/)(?:[\w./]+/)?(\w+)\.js)";$', re.M)
_COMMENT = re.compile(r"^ *(?:/\*\*.*?\*/|//[^\n]*)\n", re.M | re.S)
_INDENT = re.compile(r"^ +", re.M)
_EXPORT = re.compile(r"^export (?=(?:async )?(?:function|class|const) (\w+))", re.M)


def program(start: str = START, folder: Path = ASSETS) -> str:
    """Return a program: a script with every script that it imports, bare of comments.

    Args:
        start: Name of the script that starts the program, without `.js`.
        folder: Folder of this script. The imported ones may be in other folders; their names
            differ.
    """
    sources: dict[str, str] = {}

    def add(path: Path) -> None:
        if path.stem in sources:
            return
        source = path.read_text(encoding="utf-8")
        for _, target, _ in _IMPORT.findall(source):
            add(path.parent / target)
        source = _INDENT.sub("", _COMMENT.sub("", source))
        names = ", ".join(_EXPORT.findall(source))
        body = _EXPORT.sub("", _IMPORT.sub(r"const { \1 } = script_\3;", source))
        text = f"const script_{path.stem} = (() => {{\n{body}return {{ {names} }};\n}})();"
        sources[path.stem] = text

    add(folder / f"{start}.js")
    return "\n".join(['"use strict";', *sources.values()])


def core(options: Options) -> dict[str, Any]:
    """Return what a page needs to run the compiled core in a scenario, JSON-compatible."""
    return {"layout": layout(options), "core": base64.b64encode(CORE.read_bytes()).decode()}


def of_dial(dial: PageDial) -> dict[str, Any]:
    """Return what a page needs to turn a dial, JSON-compatible."""
    return {
        "name": dial.name,
        "dial": base64.b64encode(dial.file).decode(),
        "range": [dial.low, dial.high],
        "curve": [point._asdict() for point in dial.curve],
    }


FILE = "index.html"


def page(dial: PageDial | None = None) -> str:
    """Return the page's HTML, which turns a dial, by default the shipped ones, of both rewards.

    It makes no request; its program and its styles are named by hash.

    Raises:
        UserError: If the package was installed without the committed results.
    """
    dials = [dial] if dial else [shipped_dial(), caused_dial(), fleet_dial()]
    counts = read_json(packaged_results() / "page-core" / "machine.json")["all"]
    data = {
        **core(Options()),
        "dials": [of_dial(dial) for dial in dials],
        "crossing": crossing(),
        "fleet": fleet_data(measured=dial is None),
        "story": story(shipped=dial is None),
        "people": people_data(),
        "late": [] if dial else late_shares(),
    }
    style = (ASSETS / "style.css").read_text(encoding="utf-8")
    script = program()
    allowed = policy(script, style)
    blocks = {
        "policy": f'<meta http-equiv="Content-Security-Policy" content="{allowed}">\n',
        "title": "Turn the dial",
        "style": style,
        **{name: f"{count:,}" for name, count in counts.items()},
        "close_states": f"{counts['close_states'] / counts['observations']:.1%}",
        "source": html.escape(" ".join(dial.source for dial in dials)),
        "data": embedded(data),
        "program": script,
    }
    header, end, body = (ASSETS / "index.html").read_text(encoding="utf-8").partition("</header>\n")
    return framed(header + end, body, blocks)


def framed(header: str, body: str, blocks: Mapping[str, str]) -> str:
    """Return a page's HTML: the frame around a header and a body, with each block in its place.

    Args:
        header: HTML of the page's header.
        body: HTML of its body.
        blocks: Text by the name of its place; a place is `{name}` in the frame, the header or the
            body.
    """
    text = (ASSETS / "frame.html").read_text(encoding="utf-8")
    text = _INDENT.sub("", text.replace("{header}", header).replace("{body}", body))
    return re.sub(r"\{(\w+)\}", lambda match: blocks[match[1]], text)


def policy(script: str, style: str, connect: str = "") -> str:
    """Return a content security policy that allows one program with its worker, and one style.

    The program may compile WebAssembly.

    Args:
        script: Text of the program.
        style: Text of the style.
        connect: Sources to which the program may connect, divided by blanks; by default none.
    """
    rules = [
        "default-src 'none'",
        f"script-src {source_hash(script)} 'wasm-unsafe-eval'",
        f"style-src {source_hash(style)}",
        "worker-src blob:",
        *([f"connect-src {connect}"] if connect else []),
        "base-uri 'none'",
        "form-action 'none'",
    ]
    return "; ".join(rules)


def source_hash(text: str) -> str:
    """Return the source expression of an inline script or style in a content security policy."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def embedded(data: Mapping[str, Any]) -> str:
    """Return data as JSON that no text in it can end: for a `<script type="application/json">`."""
    return json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")


def write_page(folder: Path, dial: PageDial | None = None) -> Path:
    """Write the page of a dial, by default of the shipped ones, into a folder; return its path.

    Raises:
        UserError: If it can't be written, or the committed results did not come with the package.
    """
    path = folder / FILE
    write_atomically(path, page(dial), replace=False)
    return path
