"""Content of the page besides its scripts: core, dial, trade-off curve, and what it says."""

from __future__ import annotations

import base64
import csv
import html
import math
from statistics import NormalDist
from typing import Any

from socialiq.page.webassembly.layout import layout
from socialiq.page.webassembly.replay import CORE
from socialiq.storage import open_csv, packaged_results, read_json
from socialiq.worlds.intersection.options import Options

STUDY = "intersection-dial"
"""Study whose dial the page turns."""

FAMILY = "dial"
SEED = 50  # of the dial that is stored beside the study's tables


def content() -> dict[str, Any]:
    """Return the page's data, JSON-compatible.

    Raises:
        UserError: If the package was installed without the committed results.
    """
    dial = (packaged_results() / STUDY / "dial.safetensors").read_bytes()
    return {
        "layout": layout(Options()),
        "core": base64.b64encode(CORE.read_bytes()).decode(),
        "dial": base64.b64encode(dial).decode(),
        "curve": curve(),
    }


def curve() -> list[dict[str, Any]]:
    """Return the dial's trade-off curve: mean rewards by angle, each with a 95 % interval."""
    with open_csv(packaged_results() / STUDY / "policies.csv") as text:
        rows = [row for row in csv.DictReader(text) if row["family"] == FAMILY]
    rows = [row for row in rows if int(row["seed"]) == SEED]
    points = [
        {
            "asked": float(row["asked"]),
            "env": _mean(row, "r_env"),
            "social": _mean(row, "r_social"),
        }
        for row in rows
    ]
    return sorted(points, key=lambda point: point["asked"])


def _mean(row: dict[str, str], name: str) -> tuple[float, float, float]:
    mean = float(row[name])
    half = (
        NormalDist().inv_cdf(0.975) * float(row[f"{name}_sd"]) / math.sqrt(float(row["episodes"]))
    )
    return mean, mean - half, mean + half


def about() -> str:
    """Return what the page says of itself, as HTML."""
    counts = read_json(packaged_results() / "page-core" / "machine.json")["all"]
    return "\n".join(
        f"<h2>{html.escape(title)}</h2><p>{text}</p>" for title, text in _passages(counts)
    )


def _passages(counts: dict[str, int]) -> list[tuple[str, str]]:
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
            f"native core did, and drivers took {counts['same_decisions']:,} of "
            f"{counts['decisions']:,} decisions as there. The same episodes, not the same bits: "
            f"{counts['close_states'] / counts['observations']:.1%} of the states agree to 1e-9.",
        ),
        (
            "Where the curve comes from",
            f"The study {STUDY}: 2,000 episodes at each angle, training seed {SEED}. "
            "<code>socialiq reproduce intersection-dial</code> makes it again.",
        ),
    ]
