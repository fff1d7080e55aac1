import re

import pytest

from socialiq.audit.evidence.replay import Pose
from socialiq.audit.report.animations import HELD, ground_of, moving, poses, simplified
from socialiq.audit.report.views import html as page


def test_uniform_motion_needs_its_ends_alone():
    way = [Pose(float(step), 0.0, 0.0) for step in range(20)]
    assert simplified(way, 0.1) == [0, 19]
    assert simplified(way[:1], 0.1) == [0]


def test_a_stop_and_a_turn_are_kept():
    way = [Pose(min(float(step), 5.0), 0.0, 0.0 if step < 8 else 90.0) for step in range(12)]
    assert simplified(way, 0.1) == [0, 5, 7, 8, 11]


def test_poses_are_read():
    assert poses("1.5 -2 90;0 3 -180") == [Pose(1.5, -2.0, 90.0), Pose(0.0, 3.0, -180.0)]


def test_every_selected_episode_moves(report):
    found = moving(report)
    assert [(one.kind, one.number) for one in found] == [
        (kind, number) for kind in ("worst", "median") for number in (1, 2, 3)
    ]
    for one in found:
        assert one.seconds == pytest.approx((one.row["trace"]["frames"] - 1) / 2 + HELD)
        assert one.cars[-1].ego and sum(car.ego for car in one.cars) == 1
        for car in one.cars:
            percents = [frame.percent for frame in car.keyframes]
            assert percents[0] == 0.0 and percents[-1] == 100.0
            assert percents == sorted(percents)


def trace_of(*tracks, frames=5):
    rows = [
        {"ego": number == 0, "crashed": crashed, "first": first, "poses": text}
        for number, (first, text, crashed) in enumerate(tracks)
    ]
    return {"per_second": 2, "frames": frames, "tracks": rows, "actions": ""}


def test_a_vehicle_is_away_before_it_comes_and_after_it_has_left(plain):
    row = plain["episodes"]["worst"][0]
    row["trace"] = trace_of(
        (0, "0 0 0;1 0 0;2 0 0;3 0 0;4 0 0", True), (2, "9 9 -90;9 8 -90", True)
    )
    found = moving(plain)[0]
    other, ego = found.cars
    assert [frame.transform.startswith("translate(-9999px") for frame in other.keyframes] == [
        True,
        True,
        False,
        False,
        True,
        True,
    ]
    assert other.still == "" and ego.still == "translate(4 0) rotate(0)"
    assert found.way == "M0 0 L1 0 L2 0 L3 0 L4 0"
    assert found.crashes == ((4.0, 0.0), (9.0, 8.0))
    # Two seconds of 3.5 have passed when the episode ends.
    assert found.ended == pytest.approx(57.14)


def test_an_episode_that_could_not_be_shown_again_is_blank(plain):
    plain["episodes"]["median"][1]["trace"] = None
    text = page(plain)
    assert text.count('<svg class="moving"') == 5 and text.count("the policy drove otherwise") == 1
    for rows in plain["episodes"].values():
        for row in rows:
            row["trace"] = None
    text = page(plain)
    assert '<svg class="moving"' not in text
    assert "drove other episodes than in the evidence" in text


def test_an_environment_has_none(plain):
    plain["declaration"]["scenario"]["world"] = "lane.py:make"
    assert moving(plain) == [] and ground_of("lane.py:make", {}) is None
    assert '<svg class="moving"' not in page(plain)


def test_nothing_moves_for_those_who_want_no_motion_and_in_print(report):
    text = page(report)
    for medium in ("(prefers-reduced-motion: reduce)", "print"):
        rules = re.search(rf"@media {re.escape(medium)} {{(.*?)\n(?:}}|@)", text, re.DOTALL)
        assert ".moving * { animation: none !important; }" in (rules[0] if rules else "")


def test_the_view_of_a_long_road_follows_the_ego(plain):
    plain["declaration"]["scenario"]["world"] = "merge"
    for rows in plain["episodes"].values():
        for row in rows:
            row["trace"] = trace_of((0, "30 4 0;50 4 0;70 4 0;80 4 0;90 0 0", False))
    one = moving(plain)[0]
    assert one.ground.follows == (True, False)
    assert one.camera[0].transform == "translate(-30px,0px) rotate(0deg)"
    assert one.framed == "translate(-90 0) rotate(0)"
    assert page(plain).count('<g class="camera"') == 6
    assert ground_of("roundabout", {}).follows == (False, False)
    assert ground_of("socialiq/Merge-v1", {}) == ground_of("merge", {})


def test_roads_are_closed_paths():
    for world in ("crossing5", "crossing7", "intersection", "merge", "roundabout"):
        ground = ground_of(world, {})
        assert ground.road.startswith("M") and ground.road.endswith("Z")
    assert ground_of("crossing7", {}).view == (-0.5, -0.5, 7, 7)
