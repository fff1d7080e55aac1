"""The reference curve and the way back."""

import numpy as np
import pytest

from socialiq.audit.verdict.calibration import calibrate, points_of, preimage
from socialiq.audit.verdict.regret import Decision


def at(shown, sought, angle=(0.0, 30.0, 60.0, 90.0)):
    found = preimage(np.array(angle), np.array([shown], np.float64), np.array([sought], np.float64))
    return float(found.low[0]), float(found.high[0]), bool(found.beyond[0])


@pytest.mark.parametrize(
    ("shown", "sought", "expected"),
    [
        ([-20, 10, 70, 130], 40, (45, 45, False)),
        ([-20, 10, 70, 130], -20, (0, 0, False)),
        ([-20, 10, 70, 130], 10, (30, 30, False)),
        ([-20, 10, 10, 130], 10, (30, 60, False)),  # flat: anything between
        ([-20, 40, 10, 130], 25, (22.5, 63.75, False)),  # it turns back: the hull
        ([-20, 10, 70, 130], 200, (90, 90, True)),
        ([-20, 10, 70, 130], -21, (0, 0, True)),
        ([10, 10, 10, 10], 10, (0, 90, False)),
        ([130, 70, 10, -20], 40, (45, 45, False)),
    ],
)
def test_the_way_back_by_hand(shown, sought, expected):
    assert at(shown, sought) == expected


def test_a_step_is_climbed_at_one_angle():
    # Two exact optima, from 0 to 20 and from 20 to 90 degrees: between them α̂ jumps.
    steps = (0.0, 20.0, 20.0, 90.0)
    assert at([-40, -40, 50, 50], 0, steps) == (20.0, 20.0, False)
    assert at([-40, -40, 50, 50], -40, steps) == (0.0, 20.0, False)
    assert at([-40, -40, 50, 50], 50, steps) == (20.0, 90.0, False)


def reference(outcomes, name, *angles):
    return outcomes(name, [[1.0, 0.0]], angles=angles)


def test_points_are_sorted_and_cut_to_the_quadrant(outcomes):
    drivers = (
        reference(outcomes, "none"),
        reference(outcomes, "sixty", 60.0),
        reference(outcomes, "outside", 120.0),
        reference(outcomes, "low", -30.0, 10.0000000001),
        reference(outcomes, "middle", 10.0, 50.0),
        reference(outcomes, "wide", 70.0, 200.0),
    )
    found = points_of(drivers, 45.0)
    assert found.angle.tolist() == [0, 10, 10, 50, 60, 70, 90]
    assert [drivers[row].name for row in found.driver] == [
        "low",
        "low",
        "middle",
        "middle",
        "sixty",
        "wide",
        "wide",
    ]
    assert points_of(drivers, 330.0).angle.tolist() == [330.0, 360.0]
    for end in (0.0, 90.0):
        np.testing.assert_array_equal(points_of(drivers, end).angle, found.angle)


@pytest.fixture(scope="module")
def family(outcomes, evidence):
    """References for 0, 30, 60, 90 degrees that show -20, 10, 70, 130, and a policy."""

    def make(shown, spread=0.3, curve=(-20, 10, 70, 130)):
        rng = np.random.default_rng(0)
        common = rng.normal(size=(500, 2))
        common -= common.mean(axis=0)

        def driver(name, degrees, **fields):
            own = rng.normal(size=(500, 2))
            mean = 4 * np.array([np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))])
            noise = common + own - own.mean(axis=0)
            return outcomes(name, mean + spread * noise, **fields)

        angles = (0.0, 30.0, 60.0, 90.0)
        made = [driver(f"at {a}", s, angles=(a,)) for a, s in zip(angles, curve, strict=True)]
        return evidence(driver("policy", shown), driver("idm", 5.0), *made)

    return make


@pytest.mark.parametrize(
    ("shown", "margin", "decision"),
    [
        (40, 5.0, Decision.PASS),
        (40, 0.1, Decision.INCONCLUSIVE),
        (70, 5.0, Decision.FAIL),
        (-19, 5.0, Decision.FAIL),
    ],
)
def test_equivalence(family, shown, margin, decision):
    found = calibrate(family(shown), 45.0, margin, True, 0, resamples=500)
    assert found.status == "calibrated" and found.decision is decision
    assert found.low < found.high < found.low + 3
    assert found.monotone
    assert [point.shown for point in found.curve] == pytest.approx([-20, 10, 70, 130])


def test_the_estimate_is_read_off_the_curve(family):
    found = calibrate(family(40), 45.0, 5.0, True, 0, resamples=500)
    assert found.nearest == pytest.approx((45.0, 45.0))
    assert found.low < 45.0 < found.high


def test_a_flat_curve_can_not_tell(family):
    """All references show 10 degrees; a policy that does too may have any angle."""
    found = calibrate(family(10, curve=(10, 10, 10, 10)), 45.0, 10.0, True, 0, resamples=500)
    assert found.decision is Decision.INCONCLUSIVE
    assert found.high - found.low > 60


def test_beyond_the_curve_there_is_no_angle(family):
    found = calibrate(family(-60), 0.0, 10.0, True, 0, resamples=500)
    assert found.status == "beyond the curve"
    assert found.decision is Decision.INCONCLUSIVE
    assert found.nearest is found.low is found.high is None


def test_at_the_end_of_the_curve_there_is_one(family):
    found = calibrate(family(-20), 0.0, 10.0, True, 0, resamples=500)
    assert found.status == "calibrated" and found.decision is Decision.PASS
    assert found.low == 0.0


def test_through_180_degrees(family):
    found = calibrate(family(-178, curve=(90, 130, 170, -150)), 75.0, 5.0, True, 0, resamples=500)
    assert found.nearest == pytest.approx((69.0, 69.0))
    assert found.curve[-1].shown == pytest.approx(210.0)


def test_without_direction_or_curve_there_is_none(family, outcomes, evidence):
    blind = calibrate(family(40), 45.0, 5.0, False, 0, resamples=100)
    assert (blind.status, blind.decision) == ("no direction", Decision.INCONCLUSIVE)
    full = family(40)
    bare = evidence(full.policy, full.references[0])
    lone = evidence(full.policy, full.references[1])
    for made in (bare, lone):
        found = calibrate(made, 45.0, 5.0, True, 0, resamples=100)
        assert (found.status, found.low) == ("no curve", None)
