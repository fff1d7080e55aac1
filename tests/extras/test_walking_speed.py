"""The default walking speed is that of recorded pedestrians, if the environment names these."""

import csv
import os
from pathlib import Path

import numpy as np
import pytest

from socialiq.worlds.intersection.crosswalk import CrosswalkOptions

FOLDER = os.environ.get("SOCIALIQ_SIND_DATA", "")


@pytest.mark.skipif(not FOLDER, reason="SOCIALIQ_SIND_DATA names no folder")
def test_the_walking_speed_is_that_of_recorded_pedestrians():
    """Median over the medians of each pedestrian that walks 8 m or more, of three junctions."""
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
    low, median, high = np.quantile(paces, [0.16, 0.5, 0.84])
    options = CrosswalkOptions()
    assert median == pytest.approx(options.walking_speed, abs=0.05)
    assert (high - low) / 2 == pytest.approx(options.walking_speed_sd, abs=0.05)
