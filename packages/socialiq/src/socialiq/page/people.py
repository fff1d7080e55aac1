"""An episode of the page in which an altruist that doesn't weigh people obstructs them."""

from typing import Any

from socialiq.page.webassembly.layout import layout
from socialiq.storage import packaged_results, read_json
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.registry import make

EPISODE = "page-core/people.json"


def people_data() -> dict[str, Any]:
    """Return what the page needs to replay `EPISODE`; the layout has what differs from one ego's.

    Raises:
        UserError: If the package was installed without the committed results.
    """
    world: Any = make("intersection", people=0.1, cyclists=0.1)
    alone = layout(Options())
    shown = layout(world.options)
    different = {name: value for name, value in shown.items() if value != alone[name]}
    return {"layout": different, **read_json(packaged_results() / EPISODE)}
