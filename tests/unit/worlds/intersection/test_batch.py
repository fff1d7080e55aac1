"""Many episodes side by side: invalid arguments, and independence of the rows."""

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.types import Ending
from socialiq.worlds.highway.batch import State
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Intersection

GO = np.array([2, 2])


@pytest.fixture
def batch():
    made = Intersection().batch(2)
    made.reset(5)
    return made


def everything(batch, rows=slice(None)):
    """Bytes of all arrays of some rows, restricted to the slots in use."""
    made = batch.buffers
    columns = {name: column[rows].tobytes() for name, column in made._asdict().items()}
    return columns | {"waiting": batch._waiting[rows].tobytes()}


def assert_equal(one, other):
    assert {name for name in one if one[name] != other[name]} == set()


@pytest.mark.parametrize(("size", "threads", "name"), [(0, 1, "size"), (2, 0, "threads")])
def test_sizes_must_be_positive(size, threads, name):
    with pytest.raises(UserError, match=f"^{name} must be at least 1, got 0$"):
        Intersection().batch(size, threads)


def test_more_threads_than_there_are_is_refused():
    with pytest.raises(UserError, match=r"^100000 threads are more than there are"):
        Intersection().batch(2, threads=100_000).reset(0)


@pytest.mark.usefixtures("as_a_user_runs_it")
def test_unknown_back_ends_are_refused():
    with pytest.raises(UserError, match=r"'sumo': choose one of core, highway_env$"):
        Intersection().batch(2, back_end="sumo")


def test_the_first_reset_needs_a_seed():
    batch = Intersection().batch(2)
    with pytest.raises(UserError, match="needs a seed"):
        batch.reset()
    batch.reset([3], rows=[1])
    batch.reset(rows=[1])
    with pytest.raises(UserError, match="needs a seed"):
        batch.reset()


@pytest.mark.parametrize(
    ("seeds", "line"),
    [
        (-1, "whole numbers .* got -1"),
        ([3, -1], r"whole numbers .* got \[3, -1\]"),
        (True, "whole numbers"),
        (1.5, "whole numbers"),
        ([0.5, 1.5], "whole numbers"),
        ([1, None], "whole numbers"),
        ([2**64, 1], "whole numbers"),
        ([1], "2 seeds are needed, one for each row, got 1"),
        ([1, 2, 3], "2 seeds are needed, one for each row, got 3"),
    ],
    ids=str,
)
@pytest.mark.usefixtures("as_a_user_runs_it")
def test_seeds_that_will_not_do_are_refused(batch, seeds, line):
    before = everything(batch)
    with pytest.raises(UserError, match=line) as error:
        batch.reset(seeds)
    assert "\n" not in str(error.value)
    assert_equal(everything(batch), before)


@pytest.mark.parametrize("seed", [7, 2**40, 2**63])
def test_one_number_seeds_consecutive_rows(seed):
    batch = Intersection().batch(3)
    np.testing.assert_array_equal(batch.reset(seed), batch.reset([seed, seed + 1, seed + 2]))
    # of the chosen ones
    chosen = batch.reset(seed, rows=[0, 2])
    np.testing.assert_array_equal(chosen, batch.reset([seed, seed + 1, seed + 1]))


def test_seeds_may_mix_small_and_large_ones():
    batch = Intersection().batch(2)
    both = batch.reset([1, 2**63])
    np.testing.assert_array_equal(both[1:], Intersection().batch(1).reset([2**63]))


@pytest.mark.parametrize(
    ("actions", "line"),
    [
        ([2], "actions must be 2 whole numbers"),
        ([[2, 2]], "actions must be 2 whole numbers"),
        (2, "actions must be 2 whole numbers"),
        ([1.0, 2.0], "actions must be 2 whole numbers"),
        ([True, False], "actions must be 2 whole numbers"),
        ([0, 3], r"actions must be 0 to 2, got \[0, 3\]"),
        ([-1, 1], r"actions must be 0 to 2, got \[-1, 1\]"),
    ],
    ids=str,
)
def test_actions_that_will_not_do_are_refused(batch, actions, line):
    before = everything(batch)
    with pytest.raises(UserError, match=line):
        batch.step(actions)
    assert_equal(everything(batch), before)


def test_actions_may_be_of_any_integer_type(batch):
    state, found = batch.save(), []
    for actions in ([0, 2], np.array([0, 2], np.uint8), np.array([0, 2], np.int32)):
        batch.restore(state)
        found.append(batch.step(actions).speed)
    assert (found[0] == found[1]).all() and (found[0] == found[2]).all()


def test_an_episode_must_have_begun():
    batch = Intersection().batch(2)
    with pytest.raises(UserError, match="has not begun"):
        batch.step(GO)
    batch.reset([1], rows=[0])
    with pytest.raises(UserError, match="has not begun"):
        batch.step(GO)
    batch.step(GO, rows=[0])


def test_without_auto_reset_an_end_is_an_end(batch):
    while not batch.step(GO, auto_reset=False, rows=[0]).ending[0]:
        pass
    before = everything(batch)
    with pytest.raises(UserError, match="has ended: reset it first"):
        batch.step(GO)
    assert_equal(everything(batch), before)
    assert batch.step(GO, rows=[1]).ending[1] == Ending.NONE
    batch.reset(rows=[0])
    assert batch.buffers.episodes["time"].tolist() == [0.0, 1.0]


def test_rows_that_do_not_decide_stay_as_they_are(batch):
    batch.step(GO)
    before = everything(batch, slice(1))
    after = batch.step(GO, rows=np.array([False, True]))
    assert_equal(everything(batch, slice(1)), before)
    assert batch.buffers.episodes["time"].tolist() == [1.0, 2.0]
    np.testing.assert_array_equal(after.observation[1], batch.observation[1])


def test_what_a_step_returned_does_not_change_later(batch):
    first, seen = batch.step(GO), batch.observation
    kept = [column.copy() for column in (first.observation, first.speed, *first.rewards, seen)]
    batch.step(GO)
    for column, copy in zip(
        (first.observation, first.speed, *first.rewards, seen), kept, strict=True
    ):
        np.testing.assert_array_equal(column, copy)


def test_auto_reset_shows_both_the_end_and_the_beginning(drive):
    ends = 0
    for batch, made in drive(Options(), 16, 30):
        ended = made.ending != Ending.NONE
        np.testing.assert_array_equal(batch.observation[~ended], made.observation[~ended])
        assert (batch.observation[ended] != made.observation[ended]).any(axis=1).all()
        assert (batch.buffers.episodes["time"] == 0).tolist() == ended.tolist()
        ends += ended.sum()
    assert ends > 10


@pytest.mark.parametrize(
    ("changes", "size"), [({}, 3), ({"duration": 30.0}, 2), ({"observed_vehicles": 5}, 2)]
)
def test_states_of_another_shape_are_refused(changes, size, batch):
    other = Intersection(Options(**changes)).batch(size)
    other.reset(1)
    before = everything(batch)
    with pytest.raises(UserError, match="restore it under the options and the size") as error:
        batch.restore(other.save())
    assert "\n" not in str(error.value)
    assert_equal(everything(batch), before)


def test_an_episode_that_never_began_is_restored_as_such(batch):
    batch.restore(Intersection().batch(2).save())
    with pytest.raises(UserError, match="has not begun"):
        batch.step(GO)
    with pytest.raises(UserError, match="needs a seed"):
        batch.reset()


def test_rows_that_wait_for_a_reset_are_restored_as_such(batch):
    while not batch.step(GO, auto_reset=False, rows=[0]).ending[0]:
        pass
    other = Intersection().batch(2)
    other.restore(batch.save())
    with pytest.raises(UserError, match="has ended"):
        other.step(GO)
    other.step(GO, rows=[1])


@pytest.mark.parametrize("population", ["highway_env", "thesis"])
def test_a_restored_state_goes_on_to_the_last_bit(population, actions_of):
    batch, other = (Intersection(Options(population=population)).batch(8) for _ in range(2))
    batch.reset(100)
    script = [action for action, _ in zip(actions_of(8, 1), range(60), strict=False)]
    for action in script[:7]:
        batch.step(action)
    state = batch.save()
    kept = [column.copy() for column in state.arrays()]
    runs = []
    for one in (batch, batch, other):  # once straight on, twice after restoring
        if runs:
            one.restore(state)
            np.testing.assert_array_equal(one.observation, state.observation.reshape(8, -1))
        runs.append([])
        resets = 0
        for action in script:
            made = one.step(action)
            resets += (made.ending != Ending.NONE).sum()
            runs[-1].append(everything_now(one))
        assert resets > 8
    assert runs[0] == runs[1] == runs[2]
    for column, copy in zip(state.arrays(), kept, strict=True):
        np.testing.assert_array_equal(column, copy)


def everything_now(batch):
    """State in use, and all results of the last decision."""
    made, counts = batch.buffers, batch.buffers.episodes["vehicles"]
    present = [made.vehicles[row, :count].tobytes() for row, count in enumerate(counts)]
    outcome = (made.signals, made.rewards, made.classical, made.speed, made.ending, made.contact)
    seen = (made.reached, made.observation, made.episodes, made.neighbours_collided)
    return [*present, *(column.tobytes() for column in (*outcome, *seen))]


def test_rows_of_a_state_branch(actions_of):
    batch = Intersection(Options(population="thesis")).batch(6)
    batch.reset(3)
    batch.step(np.full(6, 1))
    for row in range(6):
        state = batch.save().rows([row] * 6)
        branches = Intersection(Options(population="thesis")).batch(6)
        branches.restore(state)
        made = branches.step(np.array([0, 1, 2, 0, 1, 2]))
        np.testing.assert_array_equal(made.observation[:3], made.observation[3:])
        np.testing.assert_array_equal(made.rewards.env[:3], made.rewards.env[3:])
        episodes = branches.buffers.episodes
        assert (episodes[:3] == episodes[3:]).all()
        # the stream, and so who comes next, is that of the row, whatever is done
        assert len(np.unique(episodes["state_low"])) <= 2
        assert made.speed[0] < made.speed[2]
        assert len(np.unique(made.observation[:3], axis=0)) >= 2


def test_a_row_is_the_episode_of_its_seed_alone(actions_of):
    size, steps, seeds = 7, 70, [11, 3, 3, 2**50, 0, 8, 15]
    together, singles = Intersection().batch(size), [Intersection().batch(1) for _ in seeds]
    np.testing.assert_array_equal(
        together.reset(seeds),
        np.concatenate([one.reset([seed]) for one, seed in zip(singles, seeds, strict=True)]),
    )
    resets = np.zeros(size)
    for _, action in zip(range(steps), actions_of(size, 4), strict=False):
        made = together.step(action)
        alone = [one.step(action[row : row + 1]) for row, one in enumerate(singles)]
        for name in ("observation", "ending", "speed", "contact", "neighbours_collided"):
            found = np.concatenate([getattr(one, name) for one in alone])
            np.testing.assert_array_equal(getattr(made, name), found)
        for name in ("rewards", "classical"):
            found = np.concatenate([np.array(getattr(one, name)) for one in alone], axis=1)
            np.testing.assert_array_equal(np.array(getattr(made, name)), found)
        seen = np.concatenate([one.observation for one in singles])
        np.testing.assert_array_equal(together.observation, seen)
        resets += made.ending != Ending.NONE
    assert (resets >= 2).all()


@pytest.mark.parametrize(
    ("size", "threads"),
    [
        pytest.param(64, 2, marks=pytest.mark.two_cores),
        (1, 1),
        pytest.param(3, 2, marks=pytest.mark.two_cores),
    ],
)
def test_neither_size_nor_threads_matter(size, threads, actions_of):
    reference, other = Intersection().batch(64), Intersection().batch(size, threads)
    np.testing.assert_array_equal(reference.reset(40)[:size], other.reset(40))
    for _, action in zip(range(40), actions_of(64, 5), strict=False):
        made, same = reference.step(action), other.step(action[:size])
        np.testing.assert_array_equal(made.observation[:size], same.observation)
        np.testing.assert_array_equal(made.rewards.social[:size], same.rewards.social)
    assert (reference.buffers.episodes[:size] == other.buffers.episodes).all()


@pytest.mark.parametrize(
    ("destination", "arms"),
    [("left", {1}), ("straight", {2}), ("right", {3}), ("random", {1, 2, 3})],
)
def test_the_ego_goes_where_the_option_says(destination, arms):
    batch = Intersection(Options(destination=destination)).batch(30)
    batch.reset(0)
    egos = batch.buffers.vehicles[np.arange(30), batch.buffers.episodes["controlled"][:, 0]]
    assert set(egos["destination"].tolist()) == arms


def test_states_are_plain_arrays(batch):
    state = batch.save()
    assert isinstance(state, State)
    for column, saved in zip(
        (batch.buffers.episodes, batch.buffers.vehicles, batch.buffers.observation),
        state,
        strict=False,
    ):
        assert type(saved) is np.ndarray and not np.shares_memory(column, saved)
