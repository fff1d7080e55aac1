import matplotlib.colors
import numpy as np
import pytest

from socialiq.worlds.pictures import EGO, OTHER, filmstrip, picture, pixels

STATES = {"crossing5": (0, 2, 2, 0), "crossing7": (0, 0, 0, 2, -1, 0)}


def rows_and_columns(figure, colour):
    """Positions of the pixels of exactly this colour."""
    wanted = np.rint(255 * np.array(matplotlib.colors.to_rgb(colour)))
    return np.nonzero((pixels(figure) == wanted).all(axis=-1))


@pytest.mark.parametrize("name", STATES)
def test_a_picture_has_one_axes(name, tabulated):
    figure = picture(tabulated(name).world, STATES[name])
    assert len(figure.axes) == 1
    image = pixels(figure)
    assert image.dtype == np.uint8
    assert image.shape == (300, 300, 3)
    assert pixels(picture(tabulated(name).world, STATES[name], inches=2.0)).shape == (200, 200, 3)


@pytest.mark.parametrize(
    ("name", "east"), [("crossing5", (3, 2, 2, 0)), ("crossing7", (4, 2, 0, 2, -1, 0))]
)
def test_the_ego_is_drawn_further_east_as_it_drives(name, east, tabulated):
    world = tabulated(name).world
    (_, before), (_, after) = (
        rows_and_columns(picture(world, state), EGO) for state in (STATES[name], east)
    )
    assert len(before) > 100
    assert after.mean() > before.mean() + 100


def test_the_other_is_drawn_further_north_as_it_drives(table5):
    (before, _), (after, _) = (
        rows_and_columns(picture(table5.world, (0, 2, 2, y)), OTHER) for y in (0, 4)
    )
    assert after.mean() < before.mean() - 100


def test_absent_vehicles_are_not_drawn(table7):
    counts = [
        len(rows_and_columns(picture(table7.world, (0, 0, *first, *second)), OTHER)[0])
        for first, second in [((-1, 0), (-1, 0)), ((0, 2), (-1, 0)), ((0, 2), (4, 2))]
    ]
    assert counts[0] == 0
    assert counts[2] > 1.8 * counts[1] > 0


def test_speed_shows(table7):
    images = [pixels(picture(table7.world, (0, v, -1, 0, -1, 0))) for v in (0, 1, 2)]
    assert not any(np.array_equal(images[i], images[j]) for i, j in [(0, 1), (0, 2), (1, 2)])


@pytest.mark.parametrize(("steps", "rows"), [(1, 1), (4, 1), (5, 2), (9, 3)])
def test_a_filmstrip_has_one_axes_for_each_state(steps, rows, table5):
    figure = filmstrip(table5.world, [(0, 2, 2, 0)] * steps)
    assert [axes.get_title() for axes in figure.axes] == [f"t = {t}" for t in range(steps)]
    grid = figure.axes[0].get_subplotspec().get_gridspec()
    assert (grid.nrows, grid.ncols) == (rows, min(steps, 4))
    assert pixels(figure).ndim == 3


def test_a_filmstrip_may_have_captions(table5):
    figure = filmstrip(table5.world, [(0, 2, 2, 0), (1, 2, 2, 1)], ["start", "Go"])
    assert [axes.get_title() for axes in figure.axes] == ["start", "Go"]
