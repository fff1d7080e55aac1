"""States consistent with an observation."""

import numpy as np
import pytest

from socialiq.worlds.intersection.core.imagine import imagined
from socialiq.worlds.intersection.world import Intersection

N = 60


@pytest.fixture(name="driven", scope="module")
def driven_batch():
    """Episodes some decisions old, so that vehicles are everywhere."""
    batch = Intersection().batch(N)
    batch.reset(np.arange(700, 700 + N))
    for decision in range(6):
        batch.step(np.full(N, 0 if decision < 4 else 2))
    return batch


def _imagined(batch, entropy):
    return imagined(batch.options, batch.observation, np.full(batch.size, entropy, np.uint64))


def _pairs(batch, state):
    """Pair each imagined vehicle with the real one, where its position isn't clipped."""
    real = batch.save()
    for row in range(batch.size):
        there = real.vehicles[row, : real.episodes["vehicles"][row]]
        for one in state.vehicles[row, : state.episodes["vehicles"][row]]:
            away = np.hypot(there["x"] - one["x"], there["y"] - one["y"])
            if max(abs(one["x"]), abs(one["y"])) < 99.0:
                yield one, there[away.argmin()], away.min()


def test_vehicles_stand_where_they_are_seen(driven):
    for mine, real, away in _pairs(driven, _imagined(driven, 1)):
        assert away < 1e-4
        assert mine["speed"] == pytest.approx(real["speed"], abs=1e-4)
        turned = (mine["heading"] - real["heading"] + np.pi) % (2 * np.pi) - np.pi
        assert turned == pytest.approx(0.0, abs=1e-5)
        assert mine["lane"] == real["lane"]


def test_the_ego_is_first_and_goes_where_it_was_told(driven):
    state = _imagined(driven, 1)
    real = driven.save()
    ego = state.vehicles[:, 0]
    assert (state.episodes["controlled"][:, 0] == 0).all()
    on_exit = ego["lane"] % 5 == 4
    assert (ego["destination"] == 1)[~on_exit].all()  # left of the south
    rows = np.arange(N)
    np.testing.assert_allclose(
        ego["x"], real.vehicles[rows, real.episodes["controlled"][:, 0]]["x"], atol=1e-4
    )


def test_who_is_on_an_approach_may_go_anywhere(driven):
    arms = {
        (int(one["origin"]), int(one["destination"]))
        for entropy in range(4)
        for one, _, _ in _pairs(driven, _imagined(driven, entropy))
        if one["lane"] % 5 == 0 and one["identity"] > 0
    }
    assert {origin for origin, _ in arms} == {1, 2, 3} or {origin for origin, _ in arms} == {
        0,
        1,
        2,
        3,
    }
    for origin in (1, 3):
        assert {arm for o, arm in arms if o == origin} == {0, 1, 2, 3} - {origin}


def test_who_is_far_into_a_turn_keeps_its_way(driven):
    """Lanes of one approach part within some metres; on the others' half the way is clear."""
    kept = [
        mine["destination"] == real["destination"]
        for mine, real, _ in _pairs(driven, _imagined(driven, 3))
        if mine["lane"] % 5 in (1, 2)
        and mine["identity"] > 0
        and abs(np.sin(2 * mine["heading"])) > 0.7
    ]
    assert len(kept) >= 3 and np.mean(kept) > 0.8


def test_the_same_seed_draws_the_same_and_another_does_not(driven):
    one, again, other = (_imagined(driven, entropy) for entropy in (5, 5, 6))
    np.testing.assert_array_equal(one.vehicles, again.vehicles)
    assert (one.vehicles["destination"] != other.vehicles["destination"]).any()


def test_a_decision_leads_where_the_real_one_does(driven):
    """Unobserved quantities hardly matter for most vehicles within a second."""
    before = driven.save()
    copy = Intersection(driven.options).batch(N)
    copy.restore(_imagined(driven, 0))
    actions = np.full(N, 2)
    made, thought = (one.step(actions, auto_reset=False) for one in (driven, copy))
    driven_after, thought_after = driven.buffers.after, copy.buffers.after
    distances = []
    for row in range(N):
        count = driven.buffers.present[row, 0]
        there, were = driven_after[row, :count], driven.buffers.before[row, :count]
        for slot in range(1, copy.buffers.present[row, 0]):
            mine = copy.buffers.before[row, slot]
            same = np.hypot(were["x"] - mine["x"], were["y"] - mine["y"]).argmin()
            now = thought_after[row, slot]
            distances.append(np.hypot(there["x"][same] - now["x"], there["y"][same] - now["y"]))
    driven.restore(before)
    assert np.median(distances) < 0.1
    np.testing.assert_allclose(made.speed, thought.speed, atol=1.0)
