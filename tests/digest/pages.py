"""Data of the page and of what `view` shows in it, without layouts, names and hashes of files."""

from __future__ import annotations

import contextlib
import functools
from pathlib import Path
from typing import Any

from tests.digest.audits import without_origin
from tests.digest.commands import call
from tests.digest.digest import Hashes, Item, of_plain
from tests.digest.files import SLOW, prepared

SHOWN = {
    "crossing5": ("table.safetensors", "crossing5", None),
    "crosswalk7": ("class_dial.safetensors", "crosswalk7-60", 30.0),
    "continuous": ("actor_dial.safetensors", "intersection-continuous", 30.0),
    "bicycles": ("gap_3s", "intersection-crosswalk-bicycles", None),
    "roundabout": ("python:driver.py:slow", "roundabout", None),
    "junction": ("driver", "junction.safetensors", None),
}
"""Policy, world and angle of each view of driven episodes."""


def of_page(_folder: Path) -> Hashes:
    """Hash the exact front of the page, and the curve that it measures of a user's dial."""
    from socialiq.nn.dial_policy import DialPolicy
    from socialiq.page.data import crossing, measured

    dial = DialPolicy.load(prepared() / "clock_dial.safetensors")
    curve = [list(point) for point in measured(dial, 40, 45, episodes=12)]
    return {"crossing": of_plain(crossing()), "curve": of_plain(curve)}


def of_view(view: Any) -> str:
    """Hash what a view gives the page from the start and part by part."""
    try:
        parts = [dict(view.part(number)) for number in range(view.count)]
        return of_plain([view.kind, without_origin(dict(view.data)), parts])
    finally:
        view.close()


def of_driven(policy: str, world: str, angle: float | None, _folder: Path) -> Hashes:
    """Hash the episodes of a policy that `view` drives and shows."""
    from socialiq.audit.request import Trust
    from socialiq.view.driven import driven_view

    trust = Trust(allow_code=True, isolation="none")
    with contextlib.chdir(prepared()):
        return {"view": of_view(driven_view(policy, world, angle, trust))}


def of_policy(_folder: Path) -> Hashes:
    """Hash the decisions that the page asks a dial for."""
    from tests.digest.commands import observations

    from socialiq.audit.request import Trust
    from socialiq.view.open import policy_view

    view = policy_view(str(prepared() / "clock_dial.safetensors"), 45.0, Trust())
    rows = observations(70, 16).tolist()
    asked = {"observations": rows, "decisions": list(range(16)), "angle": 30}
    try:
        assert view.decide is not None
        return {"decisions": of_plain(dict(view.decide(asked)))}
    finally:
        view.close()


def of_demonstrations(folder: Path) -> Hashes:
    """Hash the view of demonstrations of the intersection."""
    from socialiq.view.demonstrations import demonstrations_view

    path = folder / "data.safetensors"
    (folder / "driver.py").write_text(SLOW)
    drivers = ("--driver", f"a={prepared() / 'prosocial.safetensors'}")
    more = ("--driver", f"b=python:{folder / 'driver.py'}:slow", "--allow-code", "--episodes", 3)
    call("collect", "socialiq/Intersection-v1", *drivers, *more, "--out", path)
    return {"view": of_view(demonstrations_view(path))}


ITEMS = [
    Item("page/data", of_page, quick=True),
    *(
        Item(
            f"page/driven/{name}", functools.partial(of_driven, *shown), quick=name != "crosswalk7"
        )
        for name, shown in SHOWN.items()
    ),
    Item("page/policy", of_policy, quick=True),
    Item("page/demonstrations", of_demonstrations, quick=True),
]
