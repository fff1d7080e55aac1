import pytest

from socialiq.audit.report.pictures import angles, regret_at
from socialiq.audit.report.views import compatible
from socialiq.audit.report.views import html as page


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
    assert (
        compatible(drawn) == "In the blue part of the curve it is within the margin: −20° to 20°."
    )


def test_a_margin_that_excludes_nothing_has_a_picture_too(drawn):
    drawn["tests"]["regret"]["margin"] = 1e6
    found = angles(drawn)
    assert found.box.top < found.allowed < found.box.bottom
    assert len(found.within) == 1
