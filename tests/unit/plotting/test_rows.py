"""Rows over training seeds, and lines, with numbers computed by hand."""

import numpy as np

from socialiq.plotting.style import band, figure, line, spread

ROWS = [
    {"angle": angle, "seed": seed, "share": share}
    for angle, seed, share in ((90.0, 0, 0.5), (0.0, 0, 0.1), (0.0, 1, 0.3), (90.0, 1, 0.5))
]


def test_mean_least_and_largest_are_in_order_of_the_places():
    places, mean, low, high = spread(ROWS, "angle", "share")
    np.testing.assert_allclose(
        [places, mean, low, high], [[0, 90], [0.2, 0.5], [0.1, 0.5], [0.3, 0.5]]
    )


def test_a_band_is_drawn_in_percent():
    axes = figure(3.0, 2.0).subplots()
    band(axes, ROWS, "angle", "share", 100.0, color="black", marker="o", label="shares")
    (drawn,) = axes.lines
    np.testing.assert_allclose(np.asarray(drawn.get_xydata()), [[0, 20], [90, 50]])
    (filled,) = axes.collections
    np.testing.assert_allclose(filled.get_datalim(axes.transData).extents, [0, 10, 90, 50])


def test_a_line_keeps_the_order_of_the_rows():
    axes = figure(3.0, 2.0).subplots()
    line(axes, ROWS[:2], "angle", "share", color="black")
    np.testing.assert_allclose(np.asarray(axes.lines[0].get_xydata()), [[90, 0.5], [0, 0.1]])
