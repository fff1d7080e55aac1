"""Effects of drivers: their sums, the errors of Eq 4.2, and post-encroachment times by hand."""

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.evaluation.effects import _gaps, cells_lost, expected_delay, measure, summary
from socialiq.evaluation.episodes import episodes_of
from socialiq.evaluation.rollout import rollout_table
from socialiq.types import Ending
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.registry import make_grid, open_world

SEEDS = np.arange(90_000_000, 90_000_060)


@pytest.fixture(scope="module")
def world():
    return open_world("intersection-caused")


@pytest.fixture(scope="module")
def waiting(world):
    return measure(world, world.driver("wait"), SEEDS)


def test_who_waits_costs_its_followers(waiting):
    row = summary(waiting)
    assert row["delay"] == pytest.approx(waiting.delay.mean())
    assert row["delay_low"] > 20
    assert row["delay_same_approach"] > 0.8 * row["delay"]
    assert row["collision"] == 0
    assert row["gap_below_1_s"] == 0
    assert (waiting.ending == int(Ending.TIMEOUT)).all()
    assert row["harmed"] > row["helped"]


def test_eq_4_2_is_what_the_plain_world_gives(world, waiting):
    plain = open_world("intersection", spawn_probability=0.0)
    caused = open_world("intersection-caused", spawn_probability=0.0, tow_after=0.0)
    driver = plain.driver("gap_3s")
    measured = measure(caused, driver, SEEDS)
    episodes = episodes_of(plain.batch(len(SEEDS)), driver, SEEDS)
    np.testing.assert_allclose(measured.r_eq_4_2, episodes.r_social, atol=1e-9)
    np.testing.assert_allclose(measured.r_env, episodes.r_env, atol=1e-9)


def test_counts_are_of_parts(waiting):
    assert (waiting.not_caused <= waiting.charged).all()
    assert (waiting.missed <= waiting.caused).all()
    assert (waiting.gained + waiting.lost <= waiting.credited).all()
    assert waiting.caused.sum() > 50  # who queues behind it brakes


def test_drivers_share_the_world_without_the_ego(world, waiting):
    begun = {}
    measure(world, world.driver("go"), SEEDS, begun)
    [state] = begun.values()
    after_another = measure(world, world.driver("wait"), SEEDS, begun)
    assert not state.ledger.signals.any() and (state.episodes["time"] == 0).all()
    for name, column in waiting.items():
        np.testing.assert_array_equal(column, after_another[name])


def test_blocks_of_episodes_make_no_difference(world, monkeypatch):
    driver = world.driver("go")
    together = measure(world, driver, SEEDS)
    monkeypatch.setattr("socialiq.evaluation.effects.SIDE_BY_SIDE", 17)
    apart = measure(world, driver, SEEDS)
    for name, column in together.items():
        np.testing.assert_array_equal(column, apart[name])


def test_post_encroachment_times_by_hand():
    """The ego crosses east, the other south through the same place, a second later."""
    frames, speed = np.arange(60), 1.0  # m a frame
    tracks = np.full((1, 3, 60, 3), np.nan, np.float32)
    tracks[0, 0] = np.stack([speed * frames - 20, 0 * frames, 0 * frames], axis=-1)
    tracks[0, 1] = np.stack([0 * frames, speed * frames - 30, 0 * frames + np.pi / 2], axis=-1)
    tracks[0, 2] = tracks[0, 0] - [6.0, 0.0, 0.0]  # a follower does not count
    own, relation = np.array([0]), np.array([[-1, 2, 0]], np.int8)
    # The ego's rear leaves the place 3.5 m after the centre, at frame 23; the other's front
    # reaches it 3.5 m before, at frame 27.
    assert _gaps(tracks, own, relation, 10) == pytest.approx([0.4])
    relation[0, 1] = 0
    assert _gaps(tracks, own, relation, 10) == [np.inf]


def test_worlds_that_can_not_be_measured_are_refused(world):
    driver = world.driver("go")
    with pytest.raises(UserError, match="add reward=caused"):
        measure(open_world("intersection"), driver, SEEDS)
    with pytest.raises(UserError, match="at least 1"):
        measure(world, driver, [])


@pytest.mark.parametrize(
    ("sequence", "lost"), [("GGGG", 1.0), ("WGGGG", 0.0), ("WWWWGGGG", 0.0), ("GWGGG", 0.0)]
)
def test_cells_lost_in_the_5x5_world_by_pencil(sequence, lost):
    """GGGG enters the conflict cell with the other, which waits a step; after a wait none meets."""
    world = make_grid("crossing5")
    table = tabulate(world)
    costs, state, total = cells_lost(table), world.index(np.array([0, 2, 2, 0])), 0.0
    for letter in sequence:
        action = "WG".index(letter)
        total += costs[state, action]
        state = table.mdp.successor[state, action, 0]
    assert total == lost


def test_cells_lost_in_the_7x7_world_are_those_of_blocked_vehicles():
    """An ego in the conflict cell (3, 3) holds a vehicle at 1 back by 1 of 2 cells, at 2 by 2."""
    table = tabulate(make_grid("crossing7"))
    costs = cells_lost(table)

    def cost(ego, action, first, second=(-1, 0)):
        state = np.array([ego, 0, *first, *second])
        return costs[table.world.index(state), action]

    assert cost(2, 1, (1, 2)) == 1.0  # SLOW into the conflict cell
    assert cost(2, 1, (2, 2)) == 2.0
    assert cost(2, 1, (2, 2), (1, 2)) == pytest.approx(3.0)
    assert cost(2, 0, (2, 2)) == 0.0  # STOP before it
    assert cost(2, 1, (4, 2)) == 0.0  # the vehicle has passed
    assert cost(2, 1, (6, 2)) == 0.0  # it leaves, and another enters


def test_expected_delay_is_the_mean_of_rollouts():
    table = tabulate(make_grid("crossing7"))
    chances = np.full((table.mdp.n_states, 3), 1 / 3)
    costs, rollout = cells_lost(table), rollout_table(table, chances, 4000, 1).transitions
    states = table.world.index(rollout.observation.astype(np.int64))
    totals = np.bincount(rollout.episode, costs[states, rollout.action])
    error = totals.std() / len(totals) ** 0.5
    assert abs(totals.mean() - expected_delay(table, chances)) < 4 * error
