"""Collisions against what was risked: by episode, entry, conflict met and conflict pressed."""

from __future__ import annotations

from socialiq.evaluation.play import Episodes
from socialiq.statistics.tests import wilson
from socialiq.worlds.intersection.state import Contact

KINDS = {"at_fault": Contact.EGO_STRUCK, "struck": Contact.EGO_WAS_STRUCK}
"""Whose motion closed the gap: the ego's, or the other's."""


def rates(episodes: Episodes, confidence: float = 0.95) -> dict[str, float | int | None]:
    """How often the ego collides, at fault and struck, per exposure.

    A policy that never enters the junction has no collisions there, so its rate per episode says
    nothing of how it drives. An episode or an entry is a trial: its share has a Wilson interval.
    Conflicts are decisions and follow one another, so a rate per conflict has none; it counts the
    collisions of all episodes over the conflicts of all episodes.

    Args:
        episodes: What was played.
        confidence: Of the intervals.

    Returns:
        Counts `episodes`, `entries`, `conflicts`, `pressed`, and for each of `KINDS` its count,
        `KIND_per_episode` and `KIND_per_entry` with `_low` and `_high`, `KIND_per_conflict` and
        `KIND_per_pressed`. Collisions of an episode without entry don't count per entry. A rate
        over nothing is None.
    """
    entered = episodes.entered
    found: dict[str, float | int | None] = {
        "episodes": len(entered),
        "entries": int(entered.sum()),
        "conflicts": int(episodes.conflicts.sum()),
        "pressed": int(episodes.pressed.sum()),
    }
    for kind, contact in KINDS.items():
        collided = episodes.contact == contact
        count, inside = int(collided.sum()), int((collided & entered).sum())
        found[kind] = count
        found |= _share(f"{kind}_per_episode", count, len(entered), confidence)
        found |= _share(f"{kind}_per_entry", inside, int(entered.sum()), confidence)
        for exposure, met in (("conflict", episodes.conflicts), ("pressed", episodes.pressed)):
            found[f"{kind}_per_{exposure}"] = count / int(met.sum()) if met.any() else None
    return found


def _share(name: str, count: int, trials: int, confidence: float) -> dict[str, float | None]:
    share = wilson(count, trials, confidence) if trials else (None, None, None)
    return dict(zip((name, f"{name}_low", f"{name}_high"), share, strict=True))
