from collections.abc import Callable, Mapping

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.demonstrations.mixture import (
    MIXTURES,
    apportion,
    contaminated,
    equal_trajectories,
    equal_transitions,
    weighted,
)
from socialiq.errors import UserError

Make = Callable[..., Demonstrations]
Same = Callable[[Demonstrations, Demonstrations], bool]
Pools = Mapping[str, Demonstrations]

MODES: tuple[str, ...] = ("egoistic", "prosocial", "altruistic")


@pytest.fixture(name="pools", scope="module")
def three_pools(make):
    """Egoists are quick, altruists slow: 12 episodes each of 2, 2..7 and 13 transitions."""
    lengths = [[2] * 12, [2, 3, 4, 5, 6, 7] * 2, [13] * 12]
    return {
        mode: make(lengths[place], [place] * 12, mode_names=MODES, seed=place)
        for place, mode in enumerate(MODES)
    }


def drawn(mixed: Demonstrations, pool: Demonstrations) -> list[int]:
    """Episodes of a pool that are in a mixture, in order; observations identify rows."""
    numbers = {
        pool.observation[start].tobytes(): number
        for number, start in enumerate(pool.episode_starts)
    }
    firsts = [mixed.observation[start].tobytes() for start in mixed.episode_starts]
    return [numbers[first] for first in firsts if first in numbers]


def draw_each(pools: Pools, seed: int) -> dict[str, Demonstrations]:
    """One draw of every registered mixture."""
    arguments = {
        "equal_trajectories": {"episodes_each": 4},
        "equal_transitions": {"transitions_each": 20},
        "weighted": {
            "weights": {"egoistic": 1.0, "prosocial": 2.0, "altruistic": 1.0},
            "episodes": 9,
        },
        "contaminated": {
            "base": "prosocial",
            "contaminant": "egoistic",
            "share": 0.25,
            "episodes": 8,
        },
    }
    assert set(arguments) == set(MIXTURES)
    return {name: MIXTURES[name](pools, seed=seed, **arguments[name]) for name in arguments}


@given(st.integers(1, 12), st.integers(0, 100))
def test_equal_trajectories_counts_episodes(pools, each, seed):
    mixed = equal_trajectories(pools, each, seed)
    assert {mode: episodes for mode, (episodes, _) in mixed.counts().items()} == dict.fromkeys(
        MODES, each
    )
    assert mixed.counts()["egoistic"][1] == 2 * each
    assert mixed.counts()["altruistic"][1] == 13 * each


@given(st.integers(1, 24), st.integers(0, 100))
def test_equal_transitions_counts_transitions(pools, each, seed):
    mixed = equal_transitions(pools, each, seed)
    bounds = dict(zip(MODES, (2, 7, 13), strict=True))
    for mode, (episodes, transitions) in mixed.counts().items():
        assert episodes >= 1
        assert abs(transitions - each) < bounds[mode]
        # Neither one episode more nor one less would come nearer.
        lengths = pools[mode].episode_lengths[drawn(mixed, pools[mode])]
        assert abs(transitions - each) <= abs(transitions - lengths[-1] - each) or episodes == 1


def test_equal_transitions_is_exact_where_lengths_divide(pools):
    two = {mode: pools[mode] for mode in ("egoistic", "altruistic")}
    counts = equal_transitions(two, 13, seed=0).counts()
    assert counts["altruistic"] == (1, 13)
    assert counts["egoistic"] == (6, 12)  # 12 and 14 are as near: the earlier is taken
    assert equal_transitions({"egoistic": pools["egoistic"]}, 24, seed=0).n_episodes == 12


def test_equal_transitions_takes_the_episode_only_if_that_is_nearer(make):
    pool = {"a": make([10] * 3, mode_names=("a",))}
    found = [equal_transitions(pool, n, seed=0).n_transitions for n in (1, 14, 16, 25, 26, 30)]
    assert found == [10, 10, 20, 20, 30, 30]


def test_weighted_shares_episodes(pools):
    weights = {"prosocial": 0.5, "egoistic": 0.25, "altruistic": 0.25}
    mixed = weighted(pools, weights, 10, seed=1)
    episodes = {mode: n for mode, (n, _) in mixed.counts().items()}
    # Exact shares 5, 2.5, 2.5: the tie goes to the earlier weight.
    assert episodes == {"egoistic": 3, "prosocial": 5, "altruistic": 2}


def test_a_mode_of_weight_0_keeps_its_name(pools):
    mixed = weighted(pools, {"egoistic": 1.0, "prosocial": 0.0, "altruistic": 1.0}, 4, seed=0)
    assert {m: n for m, (n, _) in mixed.counts().items()} == {
        "egoistic": 2,
        "prosocial": 0,
        "altruistic": 2,
    }


@pytest.mark.parametrize(
    ("share", "expected"), [(0.0, (10, 0)), (0.1, (9, 1)), (0.25, (8, 2)), (1.0, (0, 10))]
)
def test_contaminated_has_its_share(pools, share, expected):
    mixed = contaminated(pools, "prosocial", "egoistic", share, 10, seed=0)
    assert mixed.mode_names == ("prosocial", "egoistic")
    assert tuple(episodes for episodes, _ in mixed.counts().values()) == expected


@given(st.integers(0, 2**32))
def test_no_episode_is_drawn_twice_and_all_can_be(pools, seed):
    mixed = equal_trajectories(pools, 12, seed)
    for pool in pools.values():
        assert sorted(drawn(mixed, pool)) == list(range(12))


def test_a_larger_draw_contains_the_smaller(pools):
    small, large = (equal_trajectories(pools, each, seed=7) for each in (3, 9))
    for pool in pools.values():
        assert drawn(small, pool) == drawn(large, pool)[:3]


def test_a_pool_is_drawn_alike_whatever_the_others_hold(pools):
    fewer = {**pools, "egoistic": pools["egoistic"].select(np.arange(5))}
    for mode in ("prosocial", "altruistic"):
        assert drawn(equal_trajectories(fewer, 3, 7), pools[mode]) == drawn(
            equal_trajectories(pools, 3, 7), pools[mode]
        )


def test_pools_of_one_size_are_drawn_in_different_orders(pools):
    mixed = equal_trajectories(pools, 12, seed=7)
    assert len({tuple(drawn(mixed, pool)) for pool in pools.values()}) == len(pools)


def test_every_mixture_is_decided_by_its_seed(pools, same):
    first, again, other = (draw_each(pools, seed) for seed in (3, 3, 4))
    for name in MIXTURES:
        assert same(first[name], again[name])
        assert first[name].observation.tobytes() != other[name].observation.tobytes()


def test_every_mixture_tells_how_it_was_made(pools):
    for name, mixed in draw_each(pools, 3).items():
        assert mixed.source["made_by"] == name
        assert mixed.source["seed"] == 3
        for mode, source in mixed.source["of"].items():
            assert source == pools[mode].source
    assert draw_each(pools, 3)["weighted"].source["weights"] == {
        "egoistic": 1,
        "prosocial": 2,
        "altruistic": 1,
    }


EVEN = {"egoistic": 1.0, "prosocial": 1.0, "altruistic": 3.0}
UNKNOWN = "unknown mode 'malicious': choose one of egoistic"


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda pools: equal_trajectories(pools, 13, 0), "'egoistic' needs 13 episodes and .* 12"),
        (lambda pools: equal_transitions(pools, 25, 0), "'egoistic' needs 25 transitions .* 24"),
        (lambda pools: weighted(pools, EVEN, 25, 0), "'altruistic' needs 15 episodes and .* 12"),
        (
            lambda pools: contaminated(pools, "prosocial", "egoistic", 0.1, 20, 0),
            "mode 'prosocial' needs 18 episodes and its pool has 12",
        ),
        (lambda _: equal_trajectories({}, 1, 0), "no pools to mix"),
        (
            lambda pools: equal_trajectories({"egoistic": pools["prosocial"]}, 1, 0),
            "pool of mode 'egoistic' has episodes of 'prosocial'",
        ),
        (lambda pools: equal_trajectories(pools, 0, 0), "episodes_each is 0: ask for at least 1"),
        (lambda pools: equal_transitions(pools, 0, 0), "transitions_each is 0: ask for at least"),
        (lambda pools: equal_trajectories(pools, 1, -1), "seed -1 is negative"),
        *(
            (
                lambda pools, share=share: contaminated(
                    pools, "prosocial", "egoistic", share, 10, 0
                ),
                r"share .* is outside \[0, 1\]",
            )
            for share in (-0.1, 1.1, float("nan"))
        ),
        (lambda pools: contaminated(pools, "prosocial", "malicious", 0.1, 10, 0), UNKNOWN),
        (lambda pools: contaminated(pools, "malicious", "prosocial", 0.1, 10, 0), UNKNOWN),
        (
            lambda pools: contaminated(pools, "egoistic", "egoistic", 0.1, 10, 0),
            "cannot contaminate itself",
        ),
        (
            lambda pools: weighted(pools, {"egoistic": 1.0}, 3, 0),
            "weights name egoistic where the pools are egoistic, pro",
        ),
        (lambda _: apportion({"a": 1.0}, 0), "episodes is 0: ask for at least 1"),
    ],
)
def test_what_makes_no_mixture_is_refused(pools, call, message):
    with pytest.raises(UserError, match=message):
        call(pools)


@pytest.mark.parametrize(
    ("weights", "total", "expected"),
    [
        ([1, 1, 1], 10, [4, 3, 3]),
        ([0.1, 0.9], 30, [3, 27]),
        ([0.7, 0.2, 0.1], 10, [7, 2, 1]),
        ([5, 3, 1], 7, [4, 2, 1]),  # 3.89, 2.33, 0.78
        ([1, 0], 3, [3, 0]),
        ([0.93, 0.07], 50, [47, 3]),  # a tie, though 0.07 * 50 > 3.5 in float64
    ],
)
def test_apportion_by_hand(weights, total, expected):
    named = {str(place): float(weight) for place, weight in enumerate(weights)}
    assert list(apportion(named, total).values()) == expected


@given(
    st.lists(st.floats(0, 1e6), min_size=1, max_size=6).filter(lambda weights: sum(weights) > 1e-3),
    st.integers(1, 1000),
)
def test_apportion_rounds_every_share_up_or_down(weights, total):
    counts = apportion({str(place): weight for place, weight in enumerate(weights)}, total)
    assert sum(counts.values()) == total
    for weight, count in zip(weights, counts.values(), strict=True):
        assert abs(count - weight / sum(weights) * total) < 1.0 + 1e-8


@pytest.mark.parametrize("weights", [[0.0, 0.0], [-1.0, 2.0], [np.nan, 1.0], [np.inf, 1.0], []])
def test_weights_that_are_no_proportions_are_refused(weights):
    with pytest.raises(UserError, match="weights must be finite, not negative and not all 0"):
        apportion({str(place): weight for place, weight in enumerate(weights)}, 3)
