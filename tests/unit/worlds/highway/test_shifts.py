"""Shifts: off they change nothing, and each fault is what its name says."""

import gymnasium
import numpy as np
import pytest

from socialiq import UserError
from socialiq.audit.request import SHIPPED_DIAL
from socialiq.evaluation.branching import branched_returns
from socialiq.evaluation.episodes import episodes_of
from socialiq.nn.dial_policy import DialPolicy
from socialiq.storage import packaged_results
from socialiq.worlds import registry
from socialiq.worlds.highway import shifts
from socialiq.worlds.highway.ego import EgoModel
from socialiq.worlds.highway.options import settings_of
from socialiq.worlds.highway.scene_batch import Batch
from socialiq.worlds.highway.shifted import Faults, ShiftedBatch, over
from socialiq.worlds.highway.shifts import Shift, shift_of, with_faults
from socialiq.worlds.intersection import policies
from socialiq.worlds.intersection.options import IDLE, Options
from socialiq.worlds.intersection.world import Intersection

SEEDS = np.arange(700, 712)
KEY = shifts.key_of(np.arange(4000))
EGO = EgoModel()


def rows_of(*vehicles):
    """Return an observation of an ego at the origin and other vehicles at places in metres."""
    rows = np.zeros((10, 7), np.float32)
    rows[0] = [1, 0, 0, 0, -0.4, 0, -1]
    for number, (x, y) in enumerate(vehicles, 1):
        rows[number] = [1, x / 100, y / 100, 0.2, 0, 1, 0]
    return rows.reshape(1, -1)


def test_texts_name_shifts_and_values():
    assert shift_of("late,noise=2") == Shift(latency=1, noise=2.0)
    assert str(shift_of("unseen-30,exit=right")) == "unseen=0.3,exit=right"
    assert str(shift_of("")) == "none" and not Shift().has_faults
    assert not Shift().options_of((0.0, 4.5, 9.0))
    assert all(shift_of(name) == shift for name, shift in shifts.SHIFTS.items())


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("lat", "unknown shift"),
        ("latency=9", "latency must be from 0 to 8"),
        ("unseen=nan", "unseen must be"),
        ("sight=0", "positive number of metres"),
        ("spawn=2", "spawn must be"),
        ("exit=up", "exit"),
        ("drivers=mad", "population"),
        ("rate=3", "not a multiple"),
        ("late or right", "one road and one traffic"),
        (3.0, "shift must be text, as latency=1, got 3.0"),
    ],
)
def test_a_mistake_is_refused(text, words):
    with pytest.raises(UserError, match=words):
        registry.make("intersection", shift=text)


def test_without_shifts_nothing_changes():
    plain = Intersection()
    assert plain.shifted("none") == plain == registry.make("intersection", shift="")
    assert type(plain.shifted("none").batch(2)) is Batch
    faults = Faults((Shift(),), None, EGO)
    wrapped = over(Batch)(scene=plain.scene, options=Options(), size=12, faults=faults)
    first, second = (
        episodes_of(batch, policies.policy("idm"), SEEDS) for batch in (plain.batch(12), wrapped)
    )
    assert first.keys() == second.keys()
    for name, column in first.items():
        np.testing.assert_array_equal(column, second[name])


def test_a_late_action_is_carried_out_after_so_many_decisions():
    rng = np.random.default_rng(0)
    actions = rng.integers(3, size=(6, 12))
    late, plain = Intersection().shifted("latency=2").batch(12), Intersection().batch(12)
    late.reset(SEEDS), plain.reset(SEEDS)
    applied = np.concatenate([np.full((2, 12), IDLE), actions])
    for decided, due in zip(actions, applied, strict=False):
        running = plain.running & late.running
        one, other = (
            batch.step(chosen, auto_reset=False, rows=running)
            for batch, chosen in ((late, decided), (plain, due))
        )
        np.testing.assert_array_equal(one.observation, other.observation)
        np.testing.assert_array_equal(one.rewards.env, other.rewards.env)


def test_vehicles_are_missing_with_the_declared_probability():
    observation = np.repeat(rows_of((10, 0), (0, 20), (-30, 5)), len(KEY), axis=0)
    faulty = with_faults(
        [shift_of("unseen=.3")], observation, KEY, np.full(len(KEY), 4, np.float32), EGO
    )
    rows = faulty.reshape(len(KEY), 10, 7)
    np.testing.assert_array_equal(rows[:, 0], observation.reshape(-1, 10, 7)[:, 0])
    assert 1 - rows[:, 1:, 0].sum() / (3 * len(KEY)) == pytest.approx(0.3, abs=0.015)
    present = rows[:, 1:, 0] > 0
    assert (present[:, :-1] >= present[:, 1:]).all()  # those that are left come first
    again = with_faults(
        [shift_of("unseen=.3")], observation[:7], KEY[:7], np.full(7, 4, np.float32), EGO
    )
    np.testing.assert_array_equal(again, faulty[:7])


def test_noise_is_new_for_every_vehicle_and_drift_is_shared_and_stays():
    observation = np.repeat(rows_of((10, 0), (0, 20)), len(KEY), axis=0)
    true = observation.reshape(-1, 10, 7)[:, 1:3, 1:5]

    def errors(text, time):
        now = np.full(len(KEY), time, np.float32)
        rows = with_faults([shift_of(text)], observation, KEY, now, EGO)
        return (rows.reshape(-1, 10, 7)[:, 1:3, 1:5] - true) * [100, 100, 20, 20]

    noise = errors("noise=2", 3.0)
    assert noise.std(axis=(0, 1)) == pytest.approx([2.0, 2.0, 1.0, 1.0], rel=0.03)
    assert abs(np.corrcoef(noise[:, 0, 0], noise[:, 1, 0])[0, 1]) < 0.05
    first, second = (errors("drift=2", time)[..., :2] for time in (3.0, 4.0))
    np.testing.assert_allclose(first[:, 0], first[:, 1], atol=1e-5)
    assert first.std() == pytest.approx(2.0, rel=0.03)
    correlation = np.corrcoef(first[:, 0, 0], second[:, 0, 0])[0, 1]
    assert correlation == pytest.approx(shifts.KEPT, abs=0.03)


def test_sight_ends_and_a_nearer_vehicle_hides_those_behind_it():
    observation = rows_of((10, 0.5), (24, 0), (0, 20), (0, 40))

    def seen(text):
        now = np.zeros(1, np.float32)
        rows = with_faults([shift_of(text)], observation, KEY[:1], now, EGO).reshape(10, 7)
        return [tuple(np.round(row[1:3] * 100, 3).tolist()) for row in rows[1:] if row[0]]

    assert seen("sight=25") == [(10.0, 0.5), (24.0, 0.0), (0.0, 20.0)]
    assert seen("occlusion=true") == [(10.0, 0.5), (0.0, 20.0)]


def test_every_episode_draws_one_of_several_shifts():
    drawn = shifts.values_of(shifts.shifts_of("none or late or noise-3"), "latency", KEY)
    assert drawn.mean() == pytest.approx(1 / 3, abs=0.03)
    world = Intersection().shifted("right or right,late")
    assert world.options.destination == "right" and world.shifts[1].latency == 1


def test_punctual_episodes_share_copies_where_others_are_late(monkeypatch):
    batch, follow = Intersection().shifted("none or late").batch(12), policies.policy("gap_2s")
    batch.reset(0)
    for _ in range(3):
        batch.step(np.full(12, IDLE))
    assert 0 < batch.late.sum() < 12

    def act(observation):
        return follow.predict(observation)[0]

    shared = branched_returns(batch, act)
    monkeypatch.setattr(ShiftedBatch, "late", np.ones(12, bool))
    for returns, alone in zip(shared, branched_returns(batch, act), strict=True):
        assert np.array_equal(returns, alone)


def test_environments_and_batches_show_the_same():
    options = {"shift": "late,unseen=.3", "front_end": "track=2"}
    world = registry.make("intersection", **options)
    assert "unseen=0.3" in world.description and "track=2" in world.description
    batch = world.batch(2)
    batch.reset(SEEDS[:2])
    env = gymnasium.make("socialiq/Intersection-v1", **options)
    many = gymnasium.make_vec("socialiq/Intersection-v1", 2, **options)
    first, _ = env.reset(seed=int(SEEDS[0]))
    together, _ = many.reset(seed=SEEDS[:2].tolist())
    for _ in range(3):
        np.testing.assert_array_equal(together, batch.observation)
        np.testing.assert_array_equal(first, batch.observation[0])
        batch.step(np.full(2, 2), auto_reset=False)
        first = env.step(2)[0]
        together = many.step(np.full(2, 2))[0]


def test_continuous_actions_are_late_too():
    world = registry.make("intersection-continuous", shift="late")
    batch, plain = world.batch(3), registry.make("intersection-continuous").batch(3)
    batch.reset(SEEDS[:3]), plain.reset(SEEDS[:3])
    batch.step(np.ones((3, 1), np.float32)), plain.step(np.zeros((3, 1), np.float32))
    np.testing.assert_array_equal(batch.observation, plain.observation)


def test_a_wet_road_has_smaller_steps_and_half_the_accelerations_of_its_own_drivers():
    merge, wet = registry.make("merge"), registry.make("merge", shift="wet")
    assert wet.options.target_speeds == pytest.approx((20.0, 70 / 3, 80 / 3, 30.0))
    dry, halved = (settings_of(world.options, 20.0)[0]["population"] for world in (merge, wet))
    np.testing.assert_array_equal(halved[:3], dry[:3])
    np.testing.assert_array_equal(halved[3:], dry[3:] / 2)
    assert Shift(wet=True).options_of((0.0, 4.5, 9.0))["target_speeds"] == (0.0, 3.0, 6.0, 9.0)
    assert len(Shift(wet=True).options_of((0.0, 1.0, 2.0, 3.0, 4.0))["target_speeds"]) == 7
    with pytest.raises(UserError, match="give at most 5 target_speeds, not 6"):
        registry.make("intersection", target_speeds=tuple(map(float, range(6))), shift="wet")


def test_a_dial_of_more_times_acts_as_before():
    dial = DialPolicy.load(packaged_results() / SHIPPED_DIAL)
    batch = Intersection().batch(4)
    rows = batch.reset(SEEDS[:4])
    for offset in (0, 20, 40):
        now, told = (np.column_stack([rows, np.full(4, 3 + late)]) for late in (0, offset))
        values = dial.with_times(60).at(45.0).q_values(told)
        np.testing.assert_allclose(values, dial.at(45.0).q_values(now), rtol=1e-5)
    with pytest.raises(UserError, match="values of the time"):
        dial.with_times(50)
