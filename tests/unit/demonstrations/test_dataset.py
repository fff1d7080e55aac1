import dataclasses
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.demonstrations.mixture import concatenate
from socialiq.errors import UserError
from socialiq.types import Ending, RewardPair, Transitions

Make = Callable[..., Demonstrations]
Same = Callable[[Demonstrations, Demonstrations], bool]

some_lengths = st.lists(st.integers(1, 6), min_size=1, max_size=8)
seeds = st.integers(0, 1000)


@st.composite
def tables(draw: Any) -> dict[str, Any]:
    """Arguments of `make`."""
    lengths = draw(some_lengths)
    modes = draw(st.lists(st.integers(0, 2), min_size=len(lengths), max_size=len(lengths)))
    return {"lengths": lengths, "modes": modes, "seed": draw(seeds)}


def rows_of(table: Demonstrations, episode: int) -> list[bytes]:
    """The rows of one episode, all columns but its number."""
    keep = table.episode == episode
    return [c[keep].tobytes() for name, c in table.arrays().items() if name != "episode"]


def test_the_table_is_what_learners_read(make):
    table: Transitions = make([3, 2])
    for name in ("observation", "action", "next_observation", "ending", "rewards"):
        assert getattr(table, name) is not None
    with pytest.raises(dataclasses.FrozenInstanceError):
        table.n_actions = 4  # pyright: ignore


def test_shapes_of_a_table(make):
    table = make([3, 1, 2], [0, 2, 0], n_features=5)
    assert (table.n_transitions, table.n_episodes, table.n_features) == (6, 3, 5)
    np.testing.assert_array_equal(table.episode_starts, [0, 3, 4])
    np.testing.assert_array_equal(table.episode_lengths, [3, 1, 2])
    np.testing.assert_array_equal(table.episode_modes, [0, 2, 0])
    assert table.counts() == {"egoistic": (2, 5), "prosocial": (0, 0), "altruistic": (1, 1)}
    assert table.summary() == (
        "3 episodes, 6 transitions (egoistic 2/5, prosocial 0/0, altruistic 1/1)"
    )


@given(tables())
def test_episodes_partition_the_rows(make, arguments):
    table = make(**arguments)
    assert table.episode_lengths.tolist() == arguments["lengths"]
    assert table.episode_modes.tolist() == arguments["modes"]
    np.testing.assert_array_equal(
        table.episode_starts, np.cumsum(arguments["lengths"]) - arguments["lengths"]
    )
    assert sum(episodes for episodes, _ in table.counts().values()) == table.n_episodes
    assert sum(rows for _, rows in table.counts().values()) == table.n_transitions


def test_totals_and_returns_by_hand(make):
    env, social = np.array([1.0, 2.0, 4.0, 8.0, 16.0]), np.array([0.0, 0.0, -4.0, 1.0, 1.0])
    table = dataclasses.replace(make([3, 2]), rewards=RewardPair(env, social))
    totals = table.totals()
    np.testing.assert_array_equal(totals.env, [7.0, 24.0])
    np.testing.assert_array_equal(totals.social, [-4.0, 2.0])
    to_go = table.returns("to_go", 0.5)
    np.testing.assert_array_equal(to_go.env, [3.0, 4.0, 4.0, 16.0, 16.0])
    np.testing.assert_array_equal(to_go.social, [-1.0, -2.0, -4.0, 1.5, 1.0])
    running = table.returns("running", 0.5)
    np.testing.assert_array_equal(running.env, [1.0, 2.0, 3.0, 8.0, 16.0])
    np.testing.assert_array_equal(running.social, [0.0, 0.0, -1.0, 1.0, 1.5])
    with pytest.raises(UserError, match="unknown target kind"):
        table.returns("total", 0.5)


@given(tables(), st.data())
def test_select_keeps_whole_episodes_in_the_order_given(make, arguments, data):
    table = make(**arguments)
    chosen = data.draw(st.lists(st.integers(0, table.n_episodes - 1), min_size=1, max_size=10))
    selected = table.select(np.array(chosen))
    assert selected.n_episodes == len(chosen)
    for place, episode in enumerate(chosen):
        assert rows_of(selected, place) == rows_of(table, episode)
    assert (selected.mode_names, selected.source) == (table.mode_names, table.source)


@given(tables(), st.data())
def test_select_undoes_a_permutation(make, same, arguments, data):
    table = make(**arguments)
    order = np.array(data.draw(st.permutations(range(table.n_episodes))))
    assert same(table.select(order).select(np.argsort(order)), table)


@pytest.mark.parametrize(
    ("episodes", "message"),
    [
        (np.array([0, 2]), "no episode 2: select from 0 to 1"),
        (np.array([-1]), "no episode -1: select from 0 to 1"),
        (np.array([], int), "at least one episode"),
        (np.array([True, False]), "as integers"),
        (np.array([0.0]), "as integers"),
    ],
)
def test_select_refuses_what_is_no_episode(make, episodes, message):
    with pytest.raises(UserError, match=message):
        make([2, 2]).select(episodes)


@given(tables(), st.data())
def test_concatenate_undoes_select(make, same, arguments, data):
    table = make(**arguments)
    cut = data.draw(st.integers(0, table.n_episodes - 1))
    numbers = np.arange(table.n_episodes)
    parts = [table.select(part) for part in np.split(numbers, [cut]) if len(part)]
    assert same(concatenate(parts), table)


@given(st.lists(tables(), min_size=1, max_size=4))
def test_select_undoes_concatenate(make, same, arguments):
    parts = [make(**each) for each in arguments]
    whole = concatenate(parts)
    ends = np.cumsum([part.n_episodes for part in parts])
    for part, end in zip(parts, ends, strict=True):
        found = whole.select(np.arange(end - part.n_episodes, end))
        assert same(dataclasses.replace(found, source=part.source), part)


def test_concatenate_matches_modes_by_name(make):
    first = make([2, 1], [0, 1], mode_names=("a", "b"))
    second = make([1, 3], [0, 1], mode_names=("c", "a"), seed=1)
    whole = concatenate([first, second])
    assert whole.mode_names == ("a", "b", "c")
    np.testing.assert_array_equal(whole.mode, [0, 0, 1, 2, 0, 0, 0])
    np.testing.assert_array_equal(whole.episode, [0, 0, 1, 2, 3, 3, 3])
    assert whole.counts() == {"a": (2, 5), "b": (1, 1), "c": (1, 1)}


def test_concatenate_lists_distinct_sources_once(make):
    first, second = make([1], seed=1), make([1], seed=2)
    assert concatenate([first, second, first]).source == {
        "made_by": "concatenate",
        "of": [{"seed": 1}, {"seed": 2}],
    }


@pytest.mark.parametrize(
    ("other", "message"),
    [
        ({"n_features": 4}, r"differ in n_features \(2, 4\)"),
        ({"n_actions": 5}, r"differ in n_actions \(3, 5\)"),
    ],
)
def test_concatenate_refuses_other_worlds(make, other, message):
    with pytest.raises(UserError, match=message):
        concatenate([make([1]), make([1], **other)])


def test_concatenate_refuses_nothing():
    with pytest.raises(UserError, match="pass at least one table"):
        concatenate([])


@given(tables(), st.integers(1, 4), st.data())
def test_subsample_keeps_every_nth_row_of_each_episode(make, arguments, every, data):
    table = make(**arguments)
    offset = data.draw(st.integers(0, min(arguments["lengths"]) - 1))
    thin = table.subsample(every, offset)
    for number in range(table.n_episodes):
        whole = table.observation[table.episode == number]
        np.testing.assert_array_equal(
            thin.observation[thin.episode == number], whole[offset::every]
        )
    assert thin.source == {
        "made_by": "subsample",
        "every": every,
        "offset": offset,
        "of": table.source,
    }


def test_subsample_may_lose_the_end_of_an_episode(make):
    table = make([3, 4])
    table.ending[-1], table.terminated[-1], table.truncated[-1] = Ending.TIMEOUT, False, True
    thin = table.subsample(2)
    np.testing.assert_array_equal(thin.action, table.action[[0, 2, 3, 5]])
    np.testing.assert_array_equal(thin.episode, [0, 0, 1, 1])
    assert thin.ending[-1] == Ending.NONE


@given(tables(), st.integers(1, 4), st.integers(0, 9))
def test_one_row_of_each_block_is_kept_and_terminal_rows(make, arguments, size, seed):
    table = make(**arguments)
    thin = table.one_of_each_block(size, seed)
    for number in range(table.n_episodes):
        steps = thin.step[thin.episode == number]
        length = int((table.episode == number).sum())
        assert set(steps // size) == set(range(-(-length // size)))
        ends = table.step[(table.episode == number) & table.terminated]
        doubled = len(steps) - len(set(steps // size))
        assert set(ends) <= set(steps) and doubled <= len(ends)
        whole = table.observation[table.episode == number]
        np.testing.assert_array_equal(thin.observation[thin.episode == number], whole[steps])
    np.testing.assert_array_equal(thin.step, table.one_of_each_block(size, seed).step)
    assert thin.source == {
        "made_by": "one_of_each_block",
        "size": size,
        "seed": seed,
        "of": table.source,
    }


def test_a_block_without_rows_is_refused(make):
    with pytest.raises(UserError, match="use a block of 1 or more rows"):
        make([3]).one_of_each_block(0, 0)


@pytest.mark.parametrize(
    ("every", "offset", "message"),
    [
        (0, 0, "use every >= 1, offset >= 0"),
        (2, -1, "use every >= 1, offset >= 0"),
        (1, 2, "would empty episode 1 of 2 transitions: use an offset below 2"),
    ],
)
def test_subsample_refuses_what_it_cannot_keep(make, every, offset, message):
    with pytest.raises(UserError, match=re.escape(message)):
        make([3, 2, 4]).subsample(every, offset)


def test_mode_names_can_be_reordered_and_widened(make):
    table = make([2, 1], [2, 0])
    renamed = table.with_mode_names(("altruistic", "malicious", "egoistic"))
    np.testing.assert_array_equal(renamed.mode, [0, 0, 2])
    assert renamed.counts() == {"altruistic": (1, 2), "malicious": (0, 0), "egoistic": (1, 1)}
    with pytest.raises(UserError, match="mode 'altruistic' has episodes: keep it"):
        table.with_mode_names(("egoistic", "prosocial"))


def test_returns_of_a_subsampled_table_are_refused_but_its_rewards_are_not(make):
    whole = make([5, 4])
    thinned = whole.subsample(2)
    assert thinned.step.tolist() == [0, 2, 4, 0, 2]
    for sums in (lambda: thinned.returns("to_go", 0.9), thinned.totals):
        with pytest.raises(UserError, match="episode 0 misses steps or its end"):
            sums()
    assert (thinned.returns("instantaneous", 0.9).env == thinned.rewards.env).all()
    assert (whole.subsample(1).totals().env == whole.totals().env).all()


@pytest.mark.parametrize("step", [[0, 1, 1], [0, 2, 1], [-1, 0, 1]])
def test_steps_must_increase_from_zero(make, step):
    import dataclasses

    with pytest.raises(UserError, match="column step, row"):
        dataclasses.replace(make([3]), step=np.array(step, np.int32))


def test_returns_of_an_episode_that_lost_its_end_are_refused(make):
    headless = make([3]).subsample(5)
    assert headless.n_transitions == 1
    with pytest.raises(UserError, match="misses steps or its end"):
        headless.totals()


def test_of_derives_flags_and_steps_from_the_endings():
    table = Demonstrations.of(
        observation=[[0], [1], [2], [0], [1]],
        action=[0, 1, 0, 1, 0],
        next_observation=[[1], [2], [3], [1], [2]],
        ending=[0, 0, int(Ending.COLLISION), 0, int(Ending.TIMEOUT)],
        rewards=RewardPair([1, 2, 3, 4, 5], [0.5, 0, 0, 0, -1]),
        episode=[0, 0, 0, 1, 1],
        n_actions=2,
    )
    assert table.terminated.tolist() == [False, False, True, False, False]
    assert table.truncated.tolist() == [False, False, False, False, True]
    assert table.step.tolist() == [0, 1, 2, 0, 1]
    assert table.mode_names == ("demonstrator",) and not table.mode.any()
    with pytest.raises(UserError, match="column ending, row 2: not a value"):
        Demonstrations.of(
            observation=table.observation,
            action=table.action,
            next_observation=table.next_observation,
            ending=[0, 0, 7, 0, 3],
            rewards=table.rewards,
            episode=table.episode,
            n_actions=2,
        )


def test_of_detaches_the_rewards_from_the_caller(make):
    table, env = make([2]), np.array([1.0, 2.0])
    again = Demonstrations.of(
        observation=table.observation,
        action=table.action,
        next_observation=table.next_observation,
        ending=table.ending,
        rewards=RewardPair(env, table.rewards.social),
        episode=table.episode,
        n_actions=table.n_actions,
    )
    env[:] = 0.0
    assert again.rewards.env.tolist() == [1.0, 2.0]
