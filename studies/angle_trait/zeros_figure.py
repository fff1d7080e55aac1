"""Figure of dials' zeros: what angles realise, projections on other dials, and recovered angles."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure

from socialiq.plotting.style import COLORS, figure, finish
from socialiq.types import Row
from socialiq_lab.tables import groups
from studies.angle_trait.zeros_config import CALIBRATED, PLAIN

_GREY = "#888888"


def draw_zeros(realised: list[Row], zeros: list[Row], drivers: list[Row]) -> Figure:
    """Draw r_social by angle, likeliest over own and matched angles, and inferred over planted.

    Args:
        realised: Table of that name.
        zeros: Table of that name.
        drivers: Table of that name.
    """
    drawn = figure(12.6, 3.7)
    first, second, third = drawn.subplots(1, 3)
    for name, rows in groups(realised, "dial").items():
        apart = name[0] == PLAIN
        x, y = [row["angle"] for row in rows], [row["r_social"] for row in rows]
        first.plot(x, y, color=COLORS["egoistic"] if apart else _GREY, linewidth=1.0)
    finish(first, "what angles bring others", xlabel="dial's angle, degrees", ylabel="r_social")
    trained = [row for row in zeros if not {row["driver"], row["model"]} & {PLAIN, CALIBRATED}]
    _diagonal(second)
    for name, color in (("planted", _GREY), ("matched", COLORS["prosocial"])):
        x, y = [row[name] for row in trained], [row["likeliest"] for row in trained]
        second.plot(x, y, ".", color=color, alpha=0.6, label=f"over {name}")
    finish(second, "between trained dials", 8, xlabel="degrees", ylabel="likeliest, degrees")
    _diagonal(third)
    for apart, color in ((False, COLORS["prosocial"]), (True, COLORS["egoistic"])):
        mine = [row for row in drivers if (row["driver"] == PLAIN) == apart]
        x, y = [row["planted_common"] for row in mine], [row["angle"] for row in mine]
        third.plot(x, y, ".", color=color, alpha=0.6, label=PLAIN if apart else "left out")
    finish(
        third, "family of dials", 8, xlabel="planted, common scale", ylabel="inferred, common scale"
    )
    return drawn


def _diagonal(axes: Any) -> None:
    axes.plot([0, 90], [0, 90], color=_GREY, linewidth=1.0)
