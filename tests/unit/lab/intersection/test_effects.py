"""Measures of what drivers cause, and rows over seeds."""

import numpy as np
import pytest

from socialiq.evaluation.measures import Episodes
from socialiq.types import Ending
from socialiq_lab.intersection.driving import seeds_of_blocks
from socialiq_lab.intersection.effects import (
    EffectsRun,
    effects_of,
    effects_row,
    measure_effects,
    measured,
)


def test_an_episode_in_which_a_person_is_hit_is_no_collision_of_vehicles():
    ending = np.array([Ending.COLLISION, Ending.COLLISION, Ending.ARRIVAL])
    hits = np.array([0.0, 1.0, 0.0])
    episodes = Episodes(ending=ending, signal_pedestrian_hit=hits, r_env=np.array([1.0, 2.0, 3.0]))
    names = ("r_env", "signal_pedestrian_hit", "collision", "arrival")
    rows = measured(episodes, names)
    assert rows.tolist() == [[1, 0, 1, 0], [2, 1, 0, 0], [3, 0, 0, 1]]


def test_a_row_has_means_over_seeds_and_their_range():
    runs = [np.array([[1.0, 4.0], [3.0, 4.0]]), np.array([[5.0, 4.0], [7.0, 4.0]])]
    row = effects_row(("r_env", "signal_pedestrian_delay"), runs)
    assert (row["seeds"], row["episodes"]) == (2, 2)
    assert (row["r_env"], row["r_env_least"], row["r_env_largest"]) == (4.0, 2.0, 6.0)
    assert row["pedestrian_delay"] == row["pedestrian_delay_low"] == pytest.approx(4.0)


def test_every_driver_and_shield_has_its_measures(tmp_path):
    seeds = seeds_of_blocks((7,), 2)
    run = EffectsRun(("go", "wait"), ("r_env", "delay", "arrival"), seeds, shields=(0.0, 0.0))
    shares = []
    measure_effects(run, tmp_path, {}, shares.append)
    array = effects_of(tmp_path)
    assert array.shape == (2, 2, 2, 3) and shares == [0.5, 1.0]
    np.testing.assert_array_equal(array[:, 0], array[:, 1])
    assert (array[1, 0, :, 2] == 0.0).all()  # a car that waits does not arrive
