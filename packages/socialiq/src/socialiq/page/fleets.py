"""Fleets of the page: one, four or all of eight cars at an angle, and what becomes of them."""

from typing import Any

from socialiq.page.data import CAUSED_STUDY, FAMILY, FLEET_STUDY, STUDY
from socialiq.page.webassembly.layout import layout
from socialiq.population.fleet import DURATION
from socialiq.results_folder import from_csv
from socialiq.storage import packaged_results
from socialiq.worlds.intersection.options import FleetOptions, Options

OPTIONS = FleetOptions(agents=8, spawn_probability=0.6, duration=DURATION)
COUNTS = (1, 4, 8)
"""Numbers of cars at the angle; the others have the dial's lowest one."""

DIALS = (
    f"{STUDY}/{FAMILY}.safetensors",
    f"{CAUSED_STUDY}/dial.safetensors",
    f"{FLEET_STUDY}/dial.safetensors",
)
"""Committed dials, in the order of the page's."""

RATES = "page-core/fleets.csv"


def fleet_data(measured: bool) -> dict[str, Any]:
    """Return what the page needs to drive fleets, with the rates of `DIALS` where it has these.

    The layout has what differs from that of one ego.

    Raises:
        UserError: If the package was installed without the committed results.
    """
    rows = from_csv(packaged_results() / RATES) if measured else []
    names = [name for name in (rows[0] if rows else ()) if "arrival" not in name]
    rates = {name: [row[name] for row in rows] for name in names}  # columns: each name once
    alone = layout(Options())
    several = {name: value for name, value in layout(OPTIONS).items() if value != alone[name]}
    return {"layout": several, "counts": COUNTS, "rates": rates}
