import numpy as np
import pytest

from socialiq_recordings.conflicts.ways import Way
from socialiq_recordings.road.paths import Polyline
from socialiq_recordings.world import lines


def way(points: np.ndarray, **more) -> Way:
    along = np.linspace(10.0, 20.0, 11)
    given = {"track": 0, "first": 0, "along": along, "speed": np.full(11, 10.0)}
    given |= {"length": 4.5, "width": 1.8, "lanelets": (1,), "dt": 0.1}
    return Way(line=Polyline(points), **(given | more))


def circle(radius: float) -> np.ndarray:
    angles = np.arange(0.0, np.pi, 0.01)
    return radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def test_a_circle_has_its_curvature_and_the_speed_of_it():
    line = lines.line_of(way(circle(25.0)))
    assert lines.curvature(line)[10:-10] == pytest.approx(1 / 25.0, rel=0.02)
    limits = lines.speed_limits(line, 4.0)
    assert limits[10:-10] == pytest.approx(10.0, rel=0.02)  # v² / 25 = 4


def test_a_vehicle_slows_down_before_a_curve():
    points = np.concatenate(
        [np.stack([np.full(50, 25.0), np.arange(-50.0, 0.0)], axis=1), circle(25.0)]
    )
    limits = lines.speed_limits(lines.line_of(way(points)), 4.0)
    assert limits[20] == pytest.approx(np.sqrt(limits[30] ** 2 + 2 * 1.5 * 10.0), rel=0.02)


def test_a_straight_line_has_no_limit():
    points = np.stack([np.arange(60.0), np.zeros(60)], axis=1)
    assert (lines.speed_limits(lines.line_of(way(points)), 2.5) == lines.FASTEST).all()


def test_states_are_those_of_the_frames_or_between_them():
    first, states = lines.states_of(way(circle(25.0), first=3, dt=0.2), 3)
    assert first == 0 and len(states) == 21
    assert states[:3, 0] == pytest.approx([10.0, 10.5, 11.0])


def test_a_way_lies_in_itself_and_not_in_one_beside_it_or_against_it():
    points = np.stack([np.arange(60.0), np.zeros(60)], axis=1)
    lying = lines.stretches(way(points), way(points + np.array([5.0, 0.5])), 0.3)
    [(begin, end, other_begin, other_end)] = lying.tolist()
    assert other_begin == pytest.approx(begin - 5.0)
    assert other_end == pytest.approx(end - 5.0)
    assert end == pytest.approx(58.0)
    for elsewhere in (points + np.array([0.0, 3.5]), points[::-1], points + np.array([0.0, 500.0])):
        assert len(lines.stretches(way(points), way(elsewhere), 0.3)) == 0
