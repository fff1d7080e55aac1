import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq_recordings.road.network import Lanelet


def test_tracks_know_where_they_begin(straight):
    tracks = straight([5.0, 6.0, 7.0], frames=4)
    assert tracks.starts.tolist() == [0, 4, 8, 12]
    assert (tracks.n_states, tracks.n_tracks) == (12, 3)


def test_velocity_is_split_along_the_heading(straight):
    # 5 m/s to the east, heading to the north: all of it to the right.
    tracks = straight([5.0], heading=0.0)
    turned = type(tracks)(**{**vars(tracks), "heading": np.full(10, np.pi / 2)})
    along, across = turned.along_and_across()
    np.testing.assert_allclose(along, 0.0, atol=1e-12)
    np.testing.assert_allclose(across, -5.0)


def test_kept_tracks_are_numbered_anew(straight):
    tracks = straight([5.0, 6.0, 7.0], frames=2)
    kept = tracks.select(np.array([True, False, True]))
    assert kept.track.tolist() == [0, 0, 1, 1] and kept.identity.tolist() == [100, 102]
    assert kept.vx.tolist() == [5.0, 5.0, 7.0, 7.0]
    with pytest.raises(UserError, match="no track is left"):
        tracks.select(np.zeros(3, bool))


@pytest.mark.parametrize(
    ("fields", "line"),
    [
        ({"dt": 0.0}, "dt is 0.0"),
        ({"dt": float("nan")}, "dt is nan"),
        ({"recording": " "}, "recording must be"),
        ({"x": np.zeros(20, np.float32)}, "column x is float32"),
        ({"x": np.zeros(19)}, "column x has 19 rows where track has 20"),
        ({"vx": np.full(20, np.nan)}, "column vx, row 0: not finite"),
        ({"length": np.array([4.5, 0.0])}, "column length, track 1: not above 0"),
        ({"width": np.array([4.5])}, "column width has 1 rows where identity has 2"),
        ({"road_user": np.array([0, 9], np.int8)}, "column road_user, track 1: unknown"),
        ({"heading": np.full(20, 90.0)}, "are these degrees"),
        ({"heading": np.full(20, -np.pi)}, "outside"),
        ({"track": np.arange(20, dtype=np.int32) // 5}, "numbers 4 tracks where identity has 2"),
        ({"track": np.full(20, 1, np.int32)}, "column track, row 0: number tracks 0"),
        ({"frame": np.arange(20, dtype=np.int32) * 2}, "row 1: does not follow the frame before"),
        ({"frame": np.arange(-5, 15, dtype=np.int32)}, "column frame, row 0: negative"),
        ({"source": {"a": object()}}, "source cannot be written"),
    ],
)
def test_each_break_of_the_rules_has_its_line(straight, fields, line):
    with pytest.raises(UserError, match=line):
        straight([5.0, 6.0], **fields)


def test_bounds_of_a_lanelet_have_as_many_points():
    two, three = np.zeros((2, 2)), np.zeros((3, 2))
    for left, right in ((two, three), (np.zeros((1, 2)), np.zeros((1, 2)))):
        with pytest.raises(UserError, match="lanelet 7: its bounds have"):
            Lanelet(7, left, right)
    with pytest.raises(UserError, match="lanelet 7: a point of its bounds is not finite"):
        Lanelet(7, two, np.full((2, 2), np.inf))
    with pytest.raises(UserError, match="lanelet 7: a bound is longer than 100 km"):
        Lanelet(7, two, np.array([[0.0, 0.0], [1e29, 0.0]]))
