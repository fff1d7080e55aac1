"""Places on paper, by hand."""

import pytest

from socialiq.audit.report.pictures import (
    Box,
    Scale,
    angles,
    episodes,
    means,
    path,
    regret_at,
    scale_of,
)
from socialiq.audit.report.views import compatible
from socialiq.audit.report.views import html as page


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


@pytest.fixture
def drawn(plain):
    """Two references: at (2, 0) and at (0, 2); the policy is at (1, 0)."""
    first, second = plain["references"][:2]
    first |= {"r_env": 2.0, "r_social": 0.0}
    second |= {"r_env": 0.0, "r_social": 2.0}
    plain["references"] = [first, second]
    plain["policy"]["means"] |= {"r_env": 1.0, "r_social": 0.0}
    plain["tests"]["regret"] |= {"regret": 1.0, "low": 0.8, "high": 1.2, "margin": 0.5}
    plain["tests"]["regret"]["best"] = first["name"]
    plain["tests"]["rationalised"] |= {"least": -1.0, "least_angle": 180.0, "margin": 0.5}
    plain["declaration"]["angle"] = 0.0
    return plain


def test_the_regret_by_hand(drawn):
    assert regret_at(drawn, 0.0) == pytest.approx(1.0)
    assert regret_at(drawn, 90.0) == pytest.approx(2.0)
    assert regret_at(drawn, 180.0) == pytest.approx(1.0)
    assert regret_at(drawn, -90.0) == pytest.approx(0.0)


def test_the_declared_angle_lies_on_the_curve_with_its_bounds(drawn):
    found = angles(drawn)
    assert (
        found.declared[0] == found.ends[0] == pytest.approx((found.box.left + found.box.right) / 2)
    )
    low, high = found.bounds
    assert low > found.declared[1] > high  # upwards is less on paper
    assert found.box.top <= high and low <= found.box.bottom
    assert found.allowed > found.declared[1]  # beyond the margin
    assert f"{found.declared[0]:g} {found.declared[1]:g}" in found.curve


def test_what_is_within_the_margin_is_drawn_apart(drawn):
    found = angles(drawn)
    assert len(found.within) == 1 and found.least is None
    heights = [float(one.split(" ")[1]) for one in found.within[0][1:].split(" L")]
    assert min(heights) >= found.allowed


def test_without_a_compatible_angle_the_nearest_one_is_marked_and_named(drawn):
    drawn["tests"]["rationalised"] |= {"arcs": [], "least": 0.75, "least_angle": 300.0}
    found = angles(drawn)
    assert found.least is not None
    assert found.least[0] == pytest.approx(found.box.left + 120 / 360 * 308, abs=0.01)
    assert found.curve.count("L") == 360  # the curve is there even if no angle is compatible
    words = compatible(drawn)
    assert words.startswith("At no angle is it within the margin. It is nearest at 300°")
    assert "0.75 below the best, where 0.5 is allowed" in words
    text = page(drawn)
    assert words in text and 'class="least"' in text


def test_a_compatible_angle_is_named(drawn):
    drawn["tests"]["rationalised"]["arcs"] = [{"low": 340.0, "high": 380.0}]
    assert compatible(drawn) == "In the blue part of the curve it is within the margin: 0° to 20°."


def test_a_margin_that_excludes_nothing_has_a_picture_too(drawn):
    drawn["tests"]["regret"]["margin"] = 1e6
    found = angles(drawn)
    assert found.box.top < found.allowed < found.box.bottom
    assert len(found.within) == 1
