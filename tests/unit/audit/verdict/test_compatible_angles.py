"""Arcs of angles that rationalise a behaviour."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from socialiq.audit.verdict.compatible_angles import compatible_angles
from socialiq.audit.verdict.regret import Regrets
from socialiq.social.arcs import Arc, arcs_of_grid, complement


def apart(one, other):
    return abs((one - other + 180) % 360 - 180)


@pytest.mark.parametrize(
    ("centres", "halves", "arcs"),
    [
        ([], [], [(0, 360)]),
        ([0.0], [60.0], [(60, 300)]),
        ([180.0], [60.0], [(240, 480)]),
        ([0.0, 90.0], [60.0, 60.0], [(150, 300)]),
        ([0.0, 180.0], [60.0, 60.0], [(60, 120), (240, 300)]),
        ([0.0, 120.0, 240.0], [70.0, 70.0, 70.0], []),
        ([10.0, 10.0], [30.0, 5.0], [(40, 340)]),
        ([0.0], [0.0], [(0, 360)]),
    ],
)
def test_what_open_arcs_leave_by_hand(centres, halves, arcs):
    assert complement(centres, halves) == tuple(Arc(*map(float, arc)) for arc in arcs)


@given(
    st.lists(st.tuples(st.integers(0, 359), st.integers(1, 170)), max_size=6),
    st.integers(0, 359),
)
def test_an_angle_is_left_or_ruled_out(spans, angle):
    centres, halves = ([float(one[side]) for one in spans] for side in (0, 1))
    left = any(arc.holds(float(angle)) for arc in complement(centres, halves))
    ruled_out = [apart(angle, one) < half for one, half in zip(centres, halves, strict=True)]
    assert left != any(ruled_out)


@given(st.lists(st.booleans(), min_size=12, max_size=12))
def test_runs_hold_what_is_inside(inside):
    arcs = arcs_of_grid(np.array(inside), 30.0)
    for number, one in enumerate(inside):
        assert any(arc.holds(30.0 * number) for arc in arcs) == one
    assert all(0 <= arc.low < 360 for arc in arcs)


@pytest.fixture(scope="module")
def found(outcomes, evidence):
    rng = np.random.default_rng(0)
    common, own = rng.normal(size=(400, 2)), 0.3 * rng.normal(size=(2, 400, 2))
    own -= own.mean(axis=1, keepdims=True)
    policy = outcomes("policy", common + own[0])
    made = evidence(policy, outcomes("ahead", common + own[1] + [1.0, 0.0]))
    return compatible_angles(Regrets(made, 0, 500), 0.5)


def test_one_reference_by_hand(found):
    # cos α <= 1/2 from 60 to 300 degrees
    (arc,) = found.arcs
    assert (arc.low, arc.high) == pytest.approx((60.0, 300.0))
    assert (found.least_angle, found.least) == (180.0, pytest.approx(-1.0))


def test_the_band_holds_the_arcs_between(found):
    (sure,), (possible,) = found.surely, found.possibly
    assert 60.0 < sure.low < 66.0 and 294.0 < sure.high < 300.0
    assert 54.0 < possible.low < 60.0 and 300.0 < possible.high < 306.0


def test_the_best_of_all_is_rationalised_by_a_cone_only(outcomes, evidence):
    """A vertex is best where its normal cone is (support_intervals says where)."""
    from socialiq.evaluation.front import support_intervals

    noise = np.random.default_rng(3).normal(size=(2000, 2))
    points = {"policy": (1.0, 1.0), "ego": (2.0, -1.0), "altruist": (-1.0, 2.0)}
    drivers = [outcomes(name, noise + one) for name, one in points.items()]
    made = compatible_angles(Regrets(evidence(*drivers), 0, 300), 1e-9)
    (arc,) = made.arcs
    assert (arc.low, arc.high) == pytest.approx(support_intervals(points)["policy"])
    assert arc.holds(45.0) and not arc.holds(0.0)
