import dataclasses

import numpy as np

from socialiq_recordings.conflicts.encounters import Area
from socialiq_recordings.road.network import Conflict


def test_vehicles_side_by_side_are_in_no_conflict():
    """Two left turns beside each other touch at a few degrees; below 30 no vehicle crosses."""
    area = Area(Conflict.CROSSING, (1.0, 1.0), (2.0, 2.0), 12.0, 0.0, 0.0, np.zeros((4, 2)))
    assert not area.is_conflict
    assert dataclasses.replace(area, angle=30.0).is_conflict
    assert dataclasses.replace(area, kind=Conflict.MERGING).is_conflict
