"""Arcs of angles: complements, and runs of a grid."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

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
