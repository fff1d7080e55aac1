"""Invariants of every vehicle, checked on records of many random episodes."""

import itertools

import numpy as np
import pytest

from socialiq.types import Ending
from socialiq.worlds.highway.network import EXIT
from socialiq.worlds.highway.options import Contact
from socialiq.worlds.intersection.core.geometry import LANES
from socialiq.worlds.intersection.options import POPULATIONS, Options
from socialiq.worlds.intersection.world import Intersection

BUSY = {"spawn_probability": 1.0, "initial_vehicle_count": 9}
SIZE, STEPS = 32, 40


def moment(vehicles, count, ego):
    """Present vehicles, and whether each is not the ego."""
    return vehicles[:count], np.arange(count) != ego


def now(batch):
    for row, episode in enumerate(batch.buffers.episodes):
        yield moment(batch.buffers.vehicles[row], episode["vehicles"], episode["controlled"][0])


def along_exit(vehicles):
    """Metres down an exit, -1 on another lane."""
    lanes = LANES[vehicles["lane"]]
    along = (vehicles["x"] - lanes["x"]) * lanes["along_x"]
    along += (vehicles["y"] - lanes["y"]) * lanes["along_y"]
    return np.where(vehicles["lane"] % 5 == EXIT, along, -1.0)


@pytest.fixture(params=["highway_env", "thesis"])
def options(request):
    return Options(population=request.param, **BUSY)


def test_identities_grow_in_the_order_of_the_list(options, drive):
    for batch, _ in drive(options, SIZE, STEPS):
        for vehicles, _ in now(batch):
            assert (np.diff(vehicles["identity"]) > 0).all()
            assert vehicles["identity"][0] >= 0


def test_a_vehicle_keeps_its_route_and_its_character(options, drive):
    known = [{} for _ in range(SIZE)]
    constant = ["origin", "destination", "exponent", *POPULATIONS["thesis"]._fields]
    met = 0
    for batch, made in drive(options, SIZE, STEPS):
        for row, (vehicles, _) in enumerate(now(batch)):
            if made.ending[row]:
                known[row] = {}
            for vehicle in vehicles:
                found = vehicle[constant].item()
                met += vehicle["identity"] in known[row]
                assert known[row].setdefault(int(vehicle["identity"]), found) == found
                assert vehicle["origin"] != vehicle["destination"]
    assert met > 1000


def test_only_others_yield_and_who_yields_wants_to_stand(options, drive):
    yields = 0
    for batch, _ in drive(options, SIZE, STEPS):
        for vehicles, others in now(batch):
            assert not vehicles["yielding"][~others].any()
            assert (vehicles["target_speed"][vehicles["yielding"]] == 0).all()
            yields += vehicles["yielding"].sum()
    assert yields > 100


def test_desired_speeds_survive_every_yield(drive):
    released = 0
    yielded = [set() for _ in range(SIZE)]
    for batch, made in drive(Options(population="thesis", **BUSY), SIZE, STEPS):
        for row, (vehicles, others) in enumerate(now(batch)):
            drivers = vehicles[others]
            free = ~drivers["yielding"]
            np.testing.assert_array_equal(
                drivers["target_speed"][free], drivers["desired_speed"][free]
            )
            if made.ending[row]:
                yielded[row] = set()
            yielded[row] |= set(drivers["identity"][~free].tolist())
            released += len(yielded[row] & set(drivers["identity"][free].tolist()))
    assert released > 10


def test_drivers_are_drawn_from_their_population(options, drive):
    drivers = []
    for batch, _ in drive(options, SIZE, 1):
        drivers += [vehicles[others] for vehicles, others in now(batch)]
    drivers = np.concatenate(drivers)
    assert ((drivers["exponent"] >= 3.5) & (drivers["exponent"] < 4.5)).all()
    for name, (mean, deviation, low, high) in POPULATIONS[options.population]._asdict().items():
        drawn = drivers[name]
        if deviation:
            assert ((drawn >= low) & (drawn <= high)).all()
            assert abs(drawn.mean() - mean) < 5 * deviation / np.sqrt(len(drawn))
            assert 0.7 * deviation < drawn.std() < 1.2 * deviation
        else:
            assert (drawn == mean).all()


def test_who_nears_the_end_of_an_exit_is_removed(options, drive):
    cleared = 0
    for batch, made in drive(options, SIZE, STEPS):
        after, present = batch.buffers.after, batch.buffers.present
        for row, (vehicles, others) in enumerate(now(batch)):
            assert (along_exit(vehicles)[others] < 80).all()
            if made.ending[row]:
                continue
            reached, drivers = moment(after[row], *present[row])
            gone = ~np.isin(reached["identity"], vehicles["identity"])
            np.testing.assert_array_equal(gone, drivers & (along_exit(reached) >= 80))
            cleared += gone.sum()
    assert cleared > 20


def test_newcomers_keep_15_m_from_everybody(options, drive):
    came, refused = 0, 0
    for batch, made in drive(options, SIZE, STEPS):
        for row, (vehicles, _) in enumerate(now(batch)):
            if made.ending[row]:
                continue
            last = batch.buffers.after[row, batch.buffers.present[row, 0] - 1]["identity"]
            new = vehicles["identity"] > last
            assert new.sum() <= 1
            came, refused = came + new.sum(), refused + (not new.any())
            for one in vehicles[new]:
                others = vehicles[~new]
                apart = np.hypot(others["x"] - one["x"], others["y"] - one["y"])
                assert (apart >= 15).all()
                assert one["lane"] % 5 == 0 and one["origin"] == one["lane"] // 5
    assert came > 100 and refused > 100  # one is tried after every decision


def test_without_spawns_nobody_comes(drive):
    for batch, made in drive(Options(spawn_probability=0.0), 16, 20):
        for row, (vehicles, _) in enumerate(now(batch)):
            if not made.ending[row]:
                assert np.isin(vehicles["identity"], batch.buffers.before["identity"][row]).all()


def test_the_ego_begins_alone_at_65_m(options):
    batch = Intersection(options).batch(200)
    batch.reset(0)
    starts, challengers = [], 0
    for row, (vehicles, others) in enumerate(now(batch)):
        (ego,) = vehicles[~others]
        apart = np.hypot(vehicles["x"] - ego["x"], vehicles["y"] - ego["y"])[others]
        assert (apart >= 20).all()
        assert ego["speed"] == 10 and ego["target_speed"] == 9 and ego["lane"] == 0
        assert batch.buffers.episodes["start"][row, 0] == pytest.approx(111 - ego["y"])
        starts.append(111 - ego["y"])
        last = vehicles[others][-1:]
        challengers += (last["destination"] == (last["origin"] + 2) % 4).sum()
    assert abs(np.mean(starts) - 65) < 1.5 and 3 < np.std(starts) < 7
    assert challengers > 60


@pytest.fixture(scope="module")
def traced(drive):
    """(before, frames) of many decisions, as far as slots are in use."""
    kept = []
    for batch, _ in drive(Options(**BUSY), 20, STEPS, traced=True):
        made = batch.buffers
        for row, (count, _) in enumerate(made.present):
            kept.append((made.before[row, :count].copy(), made.trace[row, :, :count].copy()))
    return kept


def test_a_trace_ends_where_the_decision_ends(drive):
    for batch, _ in drive(Options(), 4, 12, traced=True):
        np.testing.assert_array_equal(batch.buffers.trace[:, -1], batch.buffers.after)
        count = batch.buffers.present[0, 0]
        identity = batch.buffers.trace[0, :, :count]["identity"]
        np.testing.assert_array_equal(identity, [batch.buffers.before["identity"][0, :count]] * 10)


def test_tracing_changes_nothing(drive):
    runs = [drive(Options(), 4, 20, traced=traced) for traced in (False, True)]
    for (_, one), (_, other) in zip(*runs, strict=True):
        np.testing.assert_array_equal(one.observation, other.observation)


def test_the_crashed_only_roll_out(traced):
    wrecks = 0
    for before, frames in traced:
        for one, following in itertools.pairwise([before, *frames]):
            crashed = one["crashed"]
            was, is_now = one[crashed], following[crashed]
            np.testing.assert_array_equal(is_now["speed"], was["speed"] + -was["speed"] * 0.1)
            np.testing.assert_array_equal(is_now["heading"], was["heading"])
            assert is_now["crashed"].all() and not is_now["steering"].any()
            straight = ~was["pushed"]
            moved = (is_now["x"] - was["x"])[straight]
            np.testing.assert_allclose(
                moved, (was["speed"] * was["along_x"] * 0.1)[straight], atol=1e-9
            )
            wrecks += crashed.sum()
    assert wrecks > 1000


def test_a_push_moves_and_crashes(traced):
    pushed = 0
    for _, frames in traced:
        for one, following in itertools.pairwise(frames):
            waiting = one["pushed"]
            assert following["crashed"][waiting].all()
            assert not one["push_x"][~waiting].any() and not one["push_y"][~waiting].any()
            pushed += waiting.sum()
    assert pushed > 30


def test_nobody_crashes_without_contact(traced):
    for before, frames in traced:
        for one, following in itertools.pairwise([before, *frames]):
            fresh = following["crashed"] & ~one["crashed"]
            for slot in np.flatnonzero(fresh):
                apart = np.hypot(one["x"] - one["x"][slot], one["y"] - one["y"][slot])
                assert (np.delete(apart, slot) < 8).any()


def test_motion_follows_heading_and_speed(traced):
    for before, frames in traced:
        one, following = before, frames[0]
        free = ~(one["pushed"] | one["crashed"])
        # the wheels were set for this sub-step, so they're read afterwards
        slip = np.arctan(np.tan(following["steering"]) / 2)
        direction = one["heading"] + slip
        x = one["x"] + 0.1 * one["speed"] * np.cos(direction)
        turned = one["heading"] + one["speed"] * np.sin(slip) / 2.5 * 0.1
        speed = one["speed"] + 0.1 * following["acceleration"]
        np.testing.assert_allclose(following["x"][free], x[free], atol=1e-9)
        np.testing.assert_allclose(following["heading"][free], turned[free], atol=1e-9)
        np.testing.assert_allclose(following["speed"][free], speed[free], atol=1e-9)
        unit = np.hypot(following["along_x"], following["along_y"])
        np.testing.assert_allclose(unit, 1.0, atol=1e-12)


def test_drivers_accelerate_by_6_at_most(traced):
    driven = [frames[~frames["crashed"] & (frames["exponent"] > 0)] for _, frames in traced]
    assert np.abs(np.concatenate(driven)["acceleration"]).max() == 6.0


def test_vehicles_stay_near_their_lane(traced):
    for _, frames in traced:
        straight = ~frames["crashed"] & ~frames["pushed"] & (frames["lane"] % 5 == 0)
        lanes = LANES[frames["lane"][straight]]
        aside = (frames["x"][straight] - lanes["x"]) * lanes["across_x"]
        aside += (frames["y"][straight] - lanes["y"]) * lanes["across_y"]
        assert (np.abs(aside) < 2).all()


@pytest.mark.parametrize(
    ("changes", "decisions"),
    [({}, 20), ({"duration": 2.5}, 3), ({"duration": 1.1, "policy_frequency": 5}, 6)],
)
def test_time_runs_out_at_the_duration(changes, decisions):
    batch = Intersection(Options(**changes)).batch(40)
    batch.reset(0)
    running, timeouts = np.ones(40, bool), 0
    for decision in range(1, decisions + 1):
        made = batch.step(np.zeros(40, int), auto_reset=False, rows=running)
        late = running & (made.ending == Ending.TIMEOUT)
        assert not late.any() or decision == decisions
        timeouts += late.sum()
        running &= made.ending == Ending.NONE
    assert not running.any()
    assert timeouts > 10
    assert batch.buffers.episodes["time"].max() == pytest.approx(
        decisions / batch.options.policy_frequency
    )


def test_endings_are_what_the_ego_did(drive):
    endings = np.zeros(4, int)
    for batch, made in drive(Options(), SIZE, 60):
        egos = batch.buffers.after[np.arange(SIZE), batch.buffers.present[:, 1]]
        crashed = made.ending == Ending.COLLISION
        np.testing.assert_array_equal(egos["crashed"], crashed)
        arrived = along_exit(egos) >= 25
        np.testing.assert_array_equal(made.ending == Ending.ARRIVAL, arrived & ~crashed)
        np.testing.assert_array_equal(made.contact != Contact.NONE, crashed)
        np.testing.assert_array_equal(made.speed, egos["speed"])
        endings += np.bincount(made.ending, minlength=4)
    assert (endings > [100, 20, 20, 0]).all()


def test_actions_step_through_the_target_speeds():
    batch = Intersection(Options(spawn_probability=0.0, initial_vehicle_count=1)).batch(3)
    batch.reset([2, 2, 2])

    def targets(*actions):
        batch.step(np.array(actions), auto_reset=False)
        return batch.buffers.vehicles["target_speed"][
            range(3), batch.buffers.episodes["controlled"][:, 0]
        ].tolist()

    assert targets(0, 1, 2) == [4.5, 9.0, 9.0]
    assert targets(0, 0, 1) == [0.0, 4.5, 9.0]
    assert targets(2, 1, 0) == [4.5, 4.5, 4.5]


def test_a_faster_clock_is_nearly_the_same_ride():
    reached = []
    for frequency in (10, 40):
        batch = Intersection(
            Options(simulation_frequency=frequency, initial_vehicle_count=1)
        ).batch(1)
        batch.reset([5])
        batch.step([2], auto_reset=False)
        reached.append(
            batch.buffers.vehicles["y"][0, batch.buffers.episodes["controlled"][:, 0][0]]
        )
    assert reached[0] == pytest.approx(reached[1], abs=0.3)
    assert reached[0] != reached[1]
