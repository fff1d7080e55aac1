"""Recorded traffic as content of the page: hand-made, two lanes that cross in the origin."""

import json

import pytest

pytest.importorskip("shapely", reason="extra `maps` is not installed")

from tests.extras.view.made import DT, EDGE, crossing, saved

from socialiq.audit.request import Trust
from socialiq.errors import UserError
from socialiq.view.open import opened
from socialiq_recordings.road.network import RoadNetwork
from socialiq_recordings.view import CHUNK, Traffic


def test_the_conflict_says_who_enters_first_and_when():
    (found,) = Traffic(crossing()).conflicts()
    assert found["tracks"] == [0, 1] and found["kind"] == "crossing"
    assert found["ego_first"] and found["complete"]
    enters = [(40 - EDGE) / 8 / DT, (56 - EDGE) / 8 / DT]
    assert [found["times"][0], found["times"][2]] == pytest.approx(enters, abs=0.5)
    assert found["pet"] == pytest.approx((56 - EDGE) / 8 - (40 + EDGE) / 8, abs=0.05)


def test_parts_hold_every_state_once():
    recording = crossing()
    traffic = Traffic(recording)
    assert traffic.frames == 120 and traffic.parts == 2
    parts = [traffic.part(number)["frames"] for number in range(traffic.parts)]
    assert [len(one) for one in parts] == [CHUNK, 20]
    rows = [row for part in parts for frame in part for row in frame]
    assert len(rows) == recording.tracks.n_states
    assert parts[0][0] == [[0, -40.0, 0.0, 0.0, 8.0], [1, 0.0, -56.0, 1.571, 8.0]]


def test_what_the_page_gets_is_json_with_rewards_of_both(tmp_path):
    found = opened(str(saved(tmp_path)), None, Trust())
    assert (found.kind, found.title, found.count) == ("traffic", "hand-made", 2)
    json.dumps([found.data, found.part(1)], allow_nan=False)
    assert [one["track"] for one in found.data["drivers"]] == [0, 1]
    for one in found.data["drivers"]:
        assert len(one["frames"]) == len(one["rewards"]) + 1
    assert [one["name"] for one in found.data["users"]] == [31, 32]


def test_without_a_map_there_is_traffic_alone(tmp_path):
    path = saved(tmp_path, crossing(road=RoadNetwork()))
    found = opened(str(path), None, Trust())
    assert (found.data["lanes"], found.data["conflicts"], found.data["drivers"]) == ([], [], [])
    assert len(found.part(0)["frames"]) == CHUNK


def test_what_is_damaged_or_needs_an_import_is_refused_in_one_line(tmp_path):
    path = saved(tmp_path)
    with pytest.raises(UserError, match="--angle is of a dial"):
        opened(str(path), 30.0, Trust())
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    (tmp_path / "broken.xml").write_text("<commonRoad><obstacle>")
    (tmp_path / "tracks.csv").write_text("a,b\n1,2\n")
    for name in ("made.safetensors", "broken.xml", "tracks.csv"):
        with pytest.raises(UserError, match=name) as refusal:
            opened(str(tmp_path / name), None, Trust())
        assert "\n" not in str(refusal.value)
        assert ("data import" in str(refusal.value)) == (name == "tracks.csv")
