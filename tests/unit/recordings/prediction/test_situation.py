from collections.abc import Callable

import numpy as np
import pytest

from socialiq_recordings.prediction.situations import Situations

Make = Callable[..., Situations]


def test_a_second_later_others_have_kept_their_speeds(situations: Make) -> None:
    seen = situations(
        1,
        gap=[20.0],
        leader_speed=[8.0],
        behind=[15.0],
        behind_speed=[12.0],
        to_area=[40.0],
        other_to_area=[30.0],
        other_speed=[6.0],
        other_gap=[10.0],
        other_leader_speed=[7.0],
    )
    later = seen.advanced(np.array([2.0]))
    assert later.speed == pytest.approx([12.0])
    assert later.last == pytest.approx([2.0])
    assert later.gap == pytest.approx([20 + 8 - 11.0])
    assert later.behind == pytest.approx([15 + 11 - 12.0])
    assert later.to_area == pytest.approx([29.0])
    assert later.other_to_area == pytest.approx([24.0])
    assert later.other_gap == pytest.approx([11.0])


def test_the_moment_before_is_of_the_same_vehicle_and_recording(situations: Make) -> None:
    seen = situations(
        6,
        vehicle=[1, 2, 1, 1, 1, 2],
        recording=[0, 0, 0, 0, 1, 0],
        time=[0.0, 0.0, 2.0, 1.0, 3.0, 1.0],
    )
    assert seen.previous().tolist() == [-1, -1, 3, 0, -1, 1]


def test_conflicts_are_cut_in_the_middle_and_other_moments_by_time(situations: Make) -> None:
    here, none = 30.0, np.inf
    seen = situations(7, vehicle=[5] * 7, to_area=[none, here, here, none, here, none, none])
    assert seen.half().tolist() == [0, 0, 1, 1, 1, 1, 1]
    assert situations(4).half().tolist() == [0, 0, 1, 1]  # without a conflict, of all moments
    assert situations(1).half().tolist() == [1]
