"""Charged brakings under each rule of influence, from Eq 4.2 to a counterfactual."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from socialiq.types import Row
from socialiq_recordings.conflicts.influence import RULES, reason
from socialiq_recordings.conflicts.pairs import Encounters
from socialiq_recordings.episodes.annotate import prepare
from socialiq_recordings.episodes.charged import charged
from socialiq_recordings.episodes.config import EpisodeConfig
from socialiq_recordings.episodes.ego_swap import Swapped

STANDING = 0.5
"""m/s; a slower ego stands."""


def brakings(encounters: Encounters, swapped: Swapped, config: EpisodeConfig) -> list[Row]:
    """Return every braking that Eq 4.2 charges to an ego, with its reason.

    Args:
        encounters: Of the recording.
        swapped: Its episodes.
        config: Options of the episodes.

    Returns:
        The recording, both vehicles, the frame at the end of the decision, the loss of speed, the
        ego's speed, the relation, and for each rule whether it keeps the braking.
    """
    scene, rows = encounters.scene, []
    identity = scene.tracks.identity
    for episode in swapped.episodes:
        way = scene.crossing(episode.track, episode.junction)
        ready = None if way is None else prepare(scene, episode.track, way, config)
        for one in [] if ready is None else charged(scene, ready):
            why = reason(encounters, episode.track, one.track, one.frames)
            kept = why.rules(encounters.config.changed)
            rows.append(
                {
                    "recording": swapped.recording,
                    "ego": int(identity[episode.track]),
                    "other": int(identity[one.track]),
                    "frame": one.frames[1],
                    "lost": one.lost,
                    "share": one.share,
                    "ego_speed": one.speed,
                    "relation": why.relation,
                    "lost_to_change": why.lost_to_change,
                    "lost_to_presence": why.lost_to_presence,
                }
                | dict(zip(RULES, kept, strict=True))
            )
    return rows


def summary(rows: Sequence[Row]) -> list[Row]:
    """Return how many charged brakings each rule keeps.

    Args:
        rows: Of `brakings`, of all recordings.

    Returns:
        For Eq 4.2 and each rule: brakings charged, their share, how many distinct losses of speed
        they are, egos per loss, the share charged to a standing ego, and the summed signal.
    """
    return [
        _rule(name, [row for row in rows if name == "Eq 4.2" or row[name]], len(rows))
        for name in ("Eq 4.2", *RULES)
    ]


def _rule(name: str, kept: Sequence[Row], total: int) -> Row:
    losses = Counter((row["recording"], row["other"], row["frame"]) for row in kept)
    return {
        "rule": name,
        "charged": len(kept),
        "kept": len(kept) / total if total else 0.0,
        "losses": len(losses),
        "egos_per_loss": len(kept) / len(losses) if losses else 0.0,
        "standing_ego": float(np.mean([row["ego_speed"] < STANDING for row in kept]))
        if kept
        else 0.0,
        "signal": float(sum(row["share"] for row in kept)),
    }
