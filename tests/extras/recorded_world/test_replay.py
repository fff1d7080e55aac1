import numpy as np
import pytest
from tests.extras.recorded_world.conftest import crossing_road, tracks

from socialiq.errors import UserError
from socialiq.types import Ending
from socialiq_recordings.recording import Recording
from socialiq_recordings.world import compare
from socialiq_recordings.world.build import build
from socialiq_recordings.world.config import LEVELS, WorldConfig
from socialiq_recordings.world.replay import replay


def test_constant_speeds_are_the_action_that_changes_nothing(world):
    made = replay(world)
    assert (made.table.action == LEVELS.index(0.0)).all()
    assert made.residual_rms == pytest.approx(0.0, abs=1e-6)
    # 6 s at 10 Hz have states of 5.9 s: five whole decisions, unless the ego has arrived.
    assert made.table.n_episodes == 3 and made.table.episode_lengths.max() == 5
    last = np.append(made.table.episode_starts[1:], made.table.n_transitions) - 1
    assert set(made.table.ending[last]) <= {Ending.TIMEOUT, Ending.ARRIVAL}


def test_progress_is_the_recorded_one(world):
    made = replay(world)
    weights = world.config.rewards
    expected = weights.progress_weight * 6.0 / weights.progress_unit
    expected += weights.speed_weight * 6.0 / world.max_speed + weights.step_weight
    row = made.table.episode_starts[1]
    assert made.table.rewards.env[row] == pytest.approx(expected, abs=1e-6)


def test_overlapping_episodes_begin_between_the_decisions(world):
    one, many = replay(world), replay(world, 0.5)
    assert many.table.n_episodes == 2 * one.table.n_episodes
    assert many.table.n_features == world.n_features


def test_too_short_a_view_demonstrates_nothing(crossing):
    short = build([crossing], WorldConfig()).world
    road = short.road._replace(
        state=short.road.state[:: len(short.road.state) // 3][:3],
        state_first=np.arange(4),
    )
    with pytest.raises(UserError, match="nothing is demonstrated"):
        replay(type(short)(road, short.config, 10.0, short.provenance))


def test_simulated_traffic_starts_as_recorded(made):
    states, _ = compare.run(made.world, 0, 20, 0)
    road = made.world.road
    for vehicle in range(3):
        first = road.state[road.state_first[vehicle]]
        assert states[0, vehicle] == pytest.approx(first)
    assert np.isfinite(states).all() and (np.diff(states[..., 0], axis=0) >= 0).all()


def test_simulated_traffic_is_measured_as_the_recorded(made):
    simulated = compare.simulate(made, 0)
    rows = {row["quantity"]: row for row in compare.table(made.observed, simulated)}
    assert simulated.vehicles == made.observed.vehicles == 3
    assert rows["speeds"]["recorded_median"] == pytest.approx(6.0, abs=0.1)
    assert rows["speeds"]["simulated_n"] == rows["speeds"]["recorded_n"]


def test_the_distance_of_two_samples():
    assert compare.distance([1.0, 2.0], [1.0, 2.0]) == 0.0
    assert compare.distance([1.0, 2.0], [3.0]) == 1.0
    assert compare.distance([1.0, 3.0], [2.0]) == 0.5
    assert compare.distance([], [2.0]) is None


def test_a_world_of_another_recording_has_its_own_vehicles():
    other = tracks("ZAM_Made-2_1_T-1", {"west": 5.0, "south": 7.0, "behind": 4.0})
    both = [Recording(one, crossing_road()) for one in (tracks(), other)]
    world = build(both, WorldConfig()).world
    assert world.road.recording_first.tolist() == [0, 3, 6]
    assert world.road.pair_first.tolist() == [0, 9, 18]
