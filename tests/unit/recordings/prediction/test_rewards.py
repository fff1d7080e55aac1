from collections.abc import Callable

import numpy as np
import pytest

from socialiq_recordings.prediction.rewards import AHEAD, UNIT, rewards
from socialiq_recordings.prediction.situations import Situations

Make = Callable[..., Situations]
GRID = np.array([-3.0, 0.0, 2.0])


def test_own_progress_by_hand(situations: Make) -> None:
    env, social = rewards(situations(1), GRID)
    # A second of acceleration, then the new speed: a/2 + (AHEAD - 1) a metres more.
    assert env[0] == pytest.approx(GRID * (AHEAD - 0.5) / UNIT)
    assert (social == 0).all()


def test_a_follower_loses_by_braking_and_none_without_the_driver(situations: Make) -> None:
    seen = situations(1, behind=[10.0], behind_speed=[10.0])
    lost = -rewards(seen, GRID).social[0]
    assert lost[0] > lost[1] > lost[2] > 0
    far = situations(1, behind=[500.0], behind_speed=[10.0])
    assert -rewards(far, GRID).social[0, 1] == pytest.approx(0.0, abs=0.02)


def test_who_comes_first_costs_the_other_and_who_yields_does_not(situations: Make) -> None:
    # Both at 10 m/s: held, the driver is there after 2 s, the other after 2.2 s.
    seen = situations(
        1,
        to_area=[20.0],
        through=[6.0],
        other_to_area=[22.0],
        other_speed=[10.0],
        other_through=[6.0],
    )
    social = rewards(seen, GRID).social[0]
    assert social[0] == 0.0  # the driver brakes, and the other passes first
    assert social[1] < 0.0
    # A driver that leaves sooner costs less.
    assert social[1] < social[2] < 0.0


def test_after_a_merge_the_driver_leads_the_other(situations: Make) -> None:
    crossing = {
        "to_area": [5.0],
        "through": [4.0],
        "other_to_area": [20.0],
        "other_speed": [10.0],
        "other_through": [4.0],
        "speed": [4.0],
    }
    passes = rewards(situations(1, **crossing), GRID).social[0, 1]
    merges = rewards(situations(1, merging=[True], **crossing), GRID).social[0, 1]
    assert merges < passes


def test_a_standing_driver_that_does_not_start_costs_nobody(situations: Make) -> None:
    seen = situations(
        1,
        speed=[0.0],
        to_area=[2.0],
        through=[6.0],
        other_to_area=[15.0],
        other_speed=[10.0],
        other_through=[6.0],
    )
    assert rewards(seen, np.array([-1.0, 0.0])).social.tolist() == [[0.0, 0.0]]
