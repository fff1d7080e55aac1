"""The twelve recorded CommonRoad scenarios, where the environment names their folder."""

import os
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("shapely", reason="extra `data` is not installed")

from socialiq.cli.main import main
from socialiq.errors import UserError
from socialiq.types import Ending
from socialiq_lab.results import from_csv
from socialiq_recordings import files
from socialiq_recordings.episodes.ego_swap import check_distinct, demonstrations, swap
from socialiq_recordings.held_out import recordings_of, split
from socialiq_recordings.identity.duplicates import labelled
from socialiq_recordings.identity.identify import identify
from socialiq_recordings.readers.commonroad import read_commonroad

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


@pytest.fixture(scope="module")
def swapped(recordings):
    return {one.tracks.recording: swap(one) for one in recordings}


def test_everybody_is_an_episode_or_has_a_reason(swapped):
    assert sum(one.n_tracks for one in swapped.values()) == 336
    for one in swapped.values():
        assert len(one.episodes) + sum(one.left_out.values()) == one.n_tracks
    assert sum(len(one.episodes) for one in swapped.values()) > 150
    assert sum(one.n_transitions for one in swapped.values()) > 700


def test_two_of_the_twelve_are_the_same_moments(swapped):
    with pytest.raises(UserError, match="USA_Lanker-1_17_T-1 and USA_Lanker-1_3_T-1 hold the same"):
        check_distinct([swapped["USA_Lanker-1_17_T-1"], swapped["USA_Lanker-1_3_T-1"]])


def test_a_census_of_two_decisions_a_driver_has_no_posterior(recordings, tmp_path):
    file, out = tmp_path / "short.safetensors", tmp_path / "census"
    (short,) = (one for one in recordings if one.tracks.recording == "USA_Lanker-1_13_T-1")
    files.save(file, short)
    assert main(["data", "census", str(file), "--out", str(out)]) == 0
    drivers = from_csv(out / "drivers.csv")
    assert len(drivers) == 15 and all(one["decisions"] < 3 for one in drivers)
    assert not (out / "posterior.csv").exists()


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


def test_the_table_is_sound(recordings, swapped):
    distinct = labelled(recordings, list(swapped.values()), identify(recordings))
    table = demonstrations(distinct)
    assert table.n_episodes == 143
    own = table.observation.reshape(-1, 10, 7)[:, 0]
    assert (own[:, 0] == 1.0).all()
    assert (abs(table.rewards.env) < 3.0).all()
    # no vehicle collides: recorded boxes that touch by less than the slack are no collisions
    assert not (table.ending == Ending.COLLISION).any()
    # at the start of an episode the ego is south of the junction and looks north, within 45°
    south = own[table.episode_starts]
    assert np.mean((south[:, 2] > 0) & (south[:, 6] < -0.7)) > 0.9
    train, test = split(table, ["USA_Peach-4_1_T-1"])
    assert "USA_Peach-4_1_T-1" not in recordings_of(train)[0]
    assert train.n_episodes + test.n_episodes == table.n_episodes
