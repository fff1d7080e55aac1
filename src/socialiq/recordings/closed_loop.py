"""Why a recording is no world: nobody in it reacts."""

from __future__ import annotations

from socialiq.errors import UserError

_SUFFIXES = (".safetensors", ".xml", ".csv")


def refuse_recording(world: str) -> None:
    """Refuse a file where a world is asked for.

    Args:
        world: What the user named.

    Raises:
        UserError: If it is a file's name; no world's name looks like one.
    """
    if world.lower().endswith(_SUFFIXES):
        raise UserError(
            "a recording can't be driven in: its neighbours do not react, so their losses of speed "
            "are fixed whatever the policy does, and the angle would be biased; name a world that "
            "reacts (intersection), or judge the recorded drivers with `socialiq data audit`"
        )
