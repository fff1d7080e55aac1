"""Places on paper, by hand."""

import pytest

from socialiq.audit.report.pictures import Box, Scale, episodes, means, path, scale_of


def test_one_unit_is_as_long_upwards_as_to_the_right():
    scale = Scale.over([(0.0, 0.0), (10.0, 2.0)], Box(0.0, 0.0, 100.0, 100.0))
    origin, right, up = scale.at(0.0, 0.0), scale.at(1.0, 0.0), scale.at(0.0, 1.0)
    assert right[0] - origin[0] == pytest.approx(8.8) == origin[1] - up[1]
    assert (origin[0], scale.at(10.0, 0.0)[0]) == pytest.approx((6.0, 94.0))
    assert scale.at(5.0, 1.0) == pytest.approx((50.0, 50.0))


def test_ticks_are_round_and_inside():
    scale = Scale.over([(-3.0, -3.0), (9.0, 9.0)], Box(0.0, 0.0, 100.0, 100.0))
    for axis in (0, 1):
        ticks = scale.ticks(axis, 7)
        assert [tick.label for tick in ticks] == ["−2", "0", "2", "4", "6", "8"]
        assert all(0.0 <= tick.place <= 100.0 for tick in ticks)
    assert scale.ticks(1, 7)[0].place > scale.ticks(1, 7)[-1].place


def test_a_single_point_has_a_picture_too():
    scale = Scale.over([(1.0, 1.0)], Box(0.0, 0.0, 100.0, 50.0))
    assert scale.at(1.0, 1.0) == pytest.approx((50.0, 25.0))


def test_paths():
    assert path([(0.0, 1.0), (2.5, 3.0)]) == "M0 1 L2.5 3"
    assert path([(0.0, 1.0), (2.5, 3.0)], closed=True).endswith(" Z")


def test_the_declared_direction_points_there(plain):
    for angle, ahead in ((0.0, (1, 0)), (90.0, (0, -1)), (45.0, (1, -1)), (225.0, (-1, 1))):
        plain["declaration"]["angle"] = angle
        (x, y), (to_x, to_y) = means(plain).arrow
        length = max(abs(to_x - x), abs(to_y - y))
        assert (to_x - x, to_y - y) == pytest.approx([length * one for one in ahead], abs=0.1)


def test_both_pictures_of_rewards_have_one_scale(plain):
    plain["cloud"] = [[-40.0, 3.0], [2.0, 1.0]]
    scale = scale_of(plain)
    drawn = means(plain), episodes(plain)
    assert drawn[0].mean == drawn[1].mean
    assert drawn[0].x_ticks == drawn[1].x_ticks and drawn[0].y_ticks == drawn[1].y_ticks
    assert drawn[1].cloud == (scale.at(-40.0, 3.0), scale.at(2.0, 1.0))
    for x, y in (*drawn[1].cloud, *((one.x, one.y) for one in drawn[0].marks)):
        assert scale.box.left <= x <= scale.box.right and scale.box.top <= y <= scale.box.bottom


def test_of_references_in_one_place_the_first_has_its_number(plain):
    first, second, third = plain["references"][:3]
    second["r_env"], second["r_social"] = first["r_env"] + 1e-3, first["r_social"]
    third["r_env"], third["r_social"] = first["r_env"] + 5.0, first["r_social"]
    plain["references"] = [first, second, third]
    plain["tests"]["regret"]["best"] = third["name"]
    found = means(plain)
    assert [one.number for one in found.marks] == [1, 2, 3]
    assert [one.hidden for one in found.marks] == [False, True, False]
    assert found.best == (found.marks[2].x, found.marks[2].y)
