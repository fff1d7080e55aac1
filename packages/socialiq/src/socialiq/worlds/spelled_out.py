"""The spelling of a world in declarations, reports and saved files: name of 0.3.0, and options."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from socialiq.worlds import crosswalk7
from socialiq.worlds.catalogue import FIRST_RATE, INTERSECTION, ROADS, kinds_of
from socialiq.worlds.grammar import parse
from socialiq.worlds.highway.scenes import SCENES
from socialiq.worlds.highway.world import SENSED, world_of
from socialiq.worlds.intersection.generated import ROAD, GeneratedOptions
from socialiq.worlds.intersection.options import CrosswalkOptions


def declared(text: str, further: Mapping[str, Any] | None = None) -> tuple[str, dict[str, Any]]:
    """Return a world's name and options as declarations, reports and saved files have them.

    These names are those of 0.3.0, and the class weights of people are always an option.

    Args:
        text: The world.
        further: Options by key that are laid over those of the text.
    """
    name, options = written = parse(text, further)
    left: dict[str, Any] = {
        key: list(v) if isinstance(v, tuple) else v for key, v in options.items()
    }
    if name == INTERSECTION:
        if written.walks:
            name += "-crosswalk"
            rate = left.pop(FIRST_RATE, 0.0)
            if rate != getattr(CrosswalkOptions, FIRST_RATE):
                left[FIRST_RATE] = rate
        elif written.control and "agents" not in left:
            name += f"-{left.pop('actions').replace('_', '-')}"
            if left.get("offroad_terminal") and name.endswith("steering"):
                name += "-offroad"
                del left["offroad_terminal"]
        if written.caused and not written.control:
            del left["reward"]
            name += "-caused"
    if name == ROAD:
        fields = {field.name for field in dataclasses.fields(GeneratedOptions)}
        layout = GeneratedOptions(**{key: left[key] for key in fields & left.keys()})
        left |= layout.spelled
    if written.walks:
        left.setdefault("class_angle", crosswalk7.Options.class_angle)
    return name, left


def defaults(text: str) -> dict[str, Any]:
    """Return the default of every option of a named world that its name doesn't give, by field."""
    written = parse(text)
    kinds = kinds_of(written.name)
    assert kinds is not None
    fields = {name: field.default for name, (field, _) in kinds.fields.items()}
    fields |= vars(world_of(written.name).options) if written.name in SCENES else {}
    fields |= dict.fromkeys(("reward", *SENSED) if written.name in ROADS else (), "")
    fixed = written.options.keys() - {FIRST_RATE}
    return {option: default for option, default in fields.items() if option not in fixed}
