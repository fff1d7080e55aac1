"""Content of the page besides its scripts: core, dial, trade-off curve, and what it says."""

from __future__ import annotations

import base64
import html
from typing import Any

from socialiq.page.crossing import crossing
from socialiq.page.shown_dial import ShownDial
from socialiq.page.webassembly.layout import layout
from socialiq.page.webassembly.replay import CORE
from socialiq.storage import packaged_results, read_json
from socialiq.worlds.intersection.options import Options


def core(options: Options) -> dict[str, Any]:
    """Return what a page needs to run the compiled core, JSON-compatible.

    Args:
        options: Scenario.
    """
    return {"layout": layout(options), "core": base64.b64encode(CORE.read_bytes()).decode()}


def content(dial: ShownDial) -> dict[str, Any]:
    """Return the page's data, JSON-compatible."""
    return {
        **core(Options()),
        "dial": base64.b64encode(dial.file).decode(),
        "range": [dial.low, dial.high],
        "curve": [point._asdict() for point in dial.curve],
        "crossing": crossing(),
    }


def about(dial: ShownDial) -> str:
    """Return what the page says of itself, as HTML.

    Raises:
        UserError: If the package was installed without the committed results.
    """
    counts = read_json(packaged_results() / "page-core" / "machine.json")["all"]
    return "\n".join(
        f"<h2>{html.escape(title)}</h2><p>{text}</p>" for title, text in _passages(counts, dial)
    )


def _passages(counts: dict[str, int], dial: ShownDial) -> list[tuple[str, str]]:
    return [
        (
            "What is shown",
            "highway-env's intersection, compiled. The coloured car turns left; it decides once a "
            "second: slower, keep, faster. The reward of a decision is a pair: own progress and "
            "effect on others. At an angle &alpha; the network maximises cos &alpha; times the "
            "first plus sin &alpha; times the second. Twins share the seed, so the traffic is the "
            "same until an ego influences it.",
        ),
        (
            "Keys",
            "Arrow keys turn the dial, with Shift by 5&deg;. Space plays and pauses, comma and "
            "full stop step by a decision, N takes the next seed, 1 to 3 choose a twin.",
        ),
        (
            "How near this is to the Python package",
            "The core is the package's own, compiled to WebAssembly from the same source. In "
            f"{counts['same_endings']:,} of {counts['episodes']:,} test episodes it ended as the "
            "native core did, and drivers (an earlier dial and rules) took "
            f"{counts['same_decisions']:,} of "
            f"{counts['decisions']:,} decisions as there. The same episodes, not the same bits: "
            f"{counts['close_states'] / counts['observations']:.1%} of the states agree to 1e-9.",
        ),
        ("Where dial and curve come from", html.escape(dial.source)),
    ]
