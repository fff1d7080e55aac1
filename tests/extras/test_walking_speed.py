"""The default speeds are those of recorded people, if the environment names their files."""

import csv
import os
from pathlib import Path

import numpy as np
import pytest

from socialiq.worlds.intersection.options import CrosswalkOptions

FOLDER = os.environ.get("SOCIALIQ_SIND_DATA", "")


@pytest.mark.skipif(not FOLDER, reason="SOCIALIQ_SIND_DATA names no folder")
def test_the_speeds_are_those_of_recorded_people():
    """Medians over the medians of each track of 8 m or more, of three junctions.

    All tracks are labelled pedestrians; those above 2.5 m/s ride. There are three.
    """
    paces = []
    for path in sorted(Path(FOLDER).glob("*Ped_smoothed_tracks.csv")):
        tracks: dict[str, list[list[float]]] = {}
        with path.open() as file:
            for row in csv.DictReader(file):
                numbers = [float(row[name]) for name in ("x", "y", "vx", "vy")]
                tracks.setdefault(row["track_id"], []).append(numbers)
        for track in map(np.array, tracks.values()):
            pace = np.hypot(track[:, 2], track[:, 3])
            walks = pace > 0.5
            if walks.sum() > 30 and np.hypot(*(track[-1, :2] - track[0, :2])) > 8.0:
                paces.append(np.median(pace[walks]))
    options = CrosswalkOptions()
    riding = np.quantile([pace for pace in paces if pace > 2.5], [0.16, 0.5, 0.84])
    assert riding[1] == pytest.approx(options.cycling_speed, abs=0.05)
    assert (riding[2] - riding[0]) / 2 == pytest.approx(options.cycling_speed_sd, abs=0.05)
    low, median, high = np.quantile(paces, [0.16, 0.5, 0.84])
    assert median == pytest.approx(options.walking_speed, abs=0.05)
    assert (high - low) / 2 == pytest.approx(options.walking_speed_sd, abs=0.05)
