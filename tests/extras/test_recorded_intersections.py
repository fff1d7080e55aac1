"""The twelve recorded CommonRoad scenarios, where the environment names their folder."""

import os
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("shapely", reason="extra `maps` is not installed")

from socialiq.results_folder import load
from socialiq_recordings import census
from socialiq_recordings.identity.identify import identify
from socialiq_recordings.readers.commonroad import read_commonroad
from socialiq_recordings.world.build import build
from socialiq_recordings.world.config import WorldConfig
from socialiq_recordings.world.replay import replay

RESULTS = Path(__file__).parents[2] / "results" / "recordings"
FOLDER = os.environ.get("SOCIALIQ_COMMONROAD_DATA", "")
pytestmark = [
    pytest.mark.recorded,
    pytest.mark.skipif(not FOLDER, reason="SOCIALIQ_COMMONROAD_DATA names no folder"),
]


@pytest.fixture(scope="module")
def recordings():
    paths = sorted(Path(FOLDER).glob("*.xml"))
    assert len(paths) == 12
    return [read_commonroad(path).recording for path in paths]


def test_three_sites_and_ten_chains(recordings):
    """Vehicles are found by motion alone; NGSIM's numbers, which persist, confirm each."""
    found = identify(recordings)
    assert len(set(found.site)) == 3 and len(set(found.chain)) == 10
    pairs = [(found.names[one.first], found.names[one.second]) for one in found.overlaps]
    assert pairs == [
        ("USA_Lanker-1_17_T-1", "USA_Lanker-1_3_T-1"),
        ("USA_Lanker-2_16_T-1", "USA_Lanker-2_2_T-1"),
    ]
    for one in found.overlaps:
        tracks = [recordings[which].tracks for which in (one.first, one.second)]
        numbers = [
            of.identity[list(which)]
            for of, which in zip(tracks, zip(*one.vehicles, strict=True), strict=True)
        ]
        np.testing.assert_array_equal(*numbers)
        assert len(one.vehicles) == len(np.intersect1d(tracks[0].identity, tracks[1].identity))


def test_the_census_counts_every_vehicle_once(recordings):
    made = build(recordings, WorldConfig())
    drivers = census.drivers_of(made.world, replay(made.world))
    committed = load(RESULTS)
    population = census.population_of(drivers, made.identified)
    # `data import` leaves out one track that the reader still has.
    assert abs(population["drivers"] - committed.summary["population"]["drivers"]) <= 1
    rows = {(row["recording"], row["identity"]): row for row in committed.tables["drivers"]}
    compared = [one for one in drivers if one["recording"].startswith("USA_Peach")]
    assert len(compared) > 10
    for driver in compared:
        row = rows[driver["recording"], driver["identity"]]
        assert (driver["decisions"], driver["ending"]) == (row["decisions"], row["ending"])
