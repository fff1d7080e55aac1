"""Brakings of neighbours that Eq 4.2 charges to an ego."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from socialiq.worlds.highway.core import rewards
from socialiq.worlds.intersection.settings import settings_of
from socialiq_recordings.episodes.annotate import Prepared
from socialiq_recordings.episodes.scene import Scene


class Charged(NamedTuple):
    """Loss of speed of a neighbour that Eq 4.2 charges to the ego.

    Attributes:
        snapshot: Index of the snapshot at the end of the ego's decision.
        slot: The neighbour's slot there.
        track: Its track.
        frames: First and last frame of the decision.
        lost: m/s.
        share: Its part of the signal `disruption`.
        speed: The ego's speed at the end, m/s.
    """

    snapshot: int
    slot: int
    track: int
    frames: tuple[int, int]
    lost: float
    share: float
    speed: float


def charged(scene: Scene, ready: Prepared) -> list[Charged]:
    """Return all losses of speed that Eq 4.2 charges to an ego, in the order of its decisions.

    Args:
        scene: The recording.
        ready: Records of the ego's episode.
    """
    settings, found = settings_of(ready.options).view(np.recarray)[0], []
    for number in range(1, len(ready.rows)):
        here, row = ready.snapshots[number], int(ready.rows[number])
        place = here["kind"], here["along"], here["length"], here["travelled"]
        if not rewards.in_zone(*place, settings):
            continue
        there = scene.present(int(scene.tracks.frame[row]))
        seen = ready.seen[number, : len(there)]
        own = seen[here["ego"]]
        frames = (int(scene.tracks.frame[ready.rows[number - 1]]), int(scene.tracks.frame[row]))
        for slot, other in enumerate(there.tolist()):
            away = float(np.hypot(seen["x"][slot] - own["x"], seen["y"][slot] - own["y"]))
            kind = seen["kind"][slot]
            counts = rewards.counts(away, seen["same_origin"][slot], kind, settings)
            share = rewards.disruption(float(seen["lost"][slot]), settings)
            if slot != here["ego"] and counts and share > 0:
                track, lost = int(scene.tracks.track[other]), float(seen["lost"][slot])
                speed = float(own["speed"])
                found.append(Charged(number, slot, track, frames, lost, float(share), speed))
    return found
