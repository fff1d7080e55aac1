"""Labels that are recomputed where the world is known: honest ones agree, forged ones are named."""

import dataclasses

import gymnasium
import numpy as np
import pytest

from socialiq import Demonstrations, RewardPair, UserError, make, tabulate
from socialiq.demonstrations import mixture
from socialiq.evaluation.labels import MOST_SEEDS, _recorded_seeds, recompute, trusted
from socialiq.evaluation.rollout import record, rollout_env, trajectory_datasets
from socialiq.types import Ending
from socialiq.worlds.intersection import atlas

EGOIST, GIVING = "expert_egoistic", "expert_altruistic"


@pytest.fixture(scope="module", name="road")
def recorded_road():
    """Return episodes of two drivers of the intersection on the same seeds, mixed."""
    world = make("intersection")
    pools = {
        name: record(world.batch(8), atlas.load(name), range(40, 52), name, {"world": world.name})
        for name in (EGOIST, GIVING)
    }
    return mixture.equal_trajectories({k: v.transitions for k, v in pools.items()}, 9, 3)


@pytest.fixture(scope="module", name="grid")
def collected_grid():
    """Return episodes of the experts in a 7x7 world that is not the default one."""
    return trajectory_datasets(tabulate(make("crossing7", braking="one_level")), [0], 5)[0]


def forged(data: Demonstrations, episode: int, by: float) -> Demonstrations:
    """Return the table with another r_social in the first row of an episode."""
    social = data.rewards.social.copy()
    social[data.episode_starts[episode]] += by
    return dataclasses.replace(data, rewards=RewardPair(data.rewards.env, social))


@pytest.mark.parametrize("name", ["grid", "road"])
def test_honest_labels_agree_and_one_forged_label_is_dropped(name, request):
    data = request.getfixturevalue(name)
    kept, line = trusted(data, "FILE")
    assert kept is data and line == ""
    kept, line = trusted(forged(data, 7, 0.01), "FILE")
    assert kept.n_episodes == data.n_episodes - 1
    assert f"FILE: the labels of 1 of {data.n_episodes} episodes" in line
    assert line.endswith("dropped 7")
    other = data.select(np.delete(np.arange(data.n_episodes), 7))
    assert np.array_equal(kept.observation, other.observation)


@pytest.mark.parametrize("column", ["observation", "next_observation", "ending"])
@pytest.mark.parametrize("name", ["grid", "road"])
def test_rows_that_never_happened_disagree(name, column, request):
    data = request.getfixturevalue(name)
    changed = getattr(data, column).copy()
    row = int(np.flatnonzero(data.ending == Ending.ARRIVAL)[4])
    changed[row] = Ending.OTHER if column == "ending" else 1
    agrees = recompute(dataclasses.replace(data, **{column: changed})).agrees
    assert np.flatnonzero(~agrees).tolist() == [data.episode[row]]


def test_a_driver_of_an_environment_is_driven_again_with_a_clock_too():
    env = gymnasium.make("socialiq/Intersection-v1")
    source = {"world": "socialiq/Intersection-v1"}
    data = rollout_env(env, atlas.load(EGOIST), 4, 11, source=source).transitions
    for table in (data, data.with_clock()):
        checked = recompute(table)
        assert checked.world == "intersection" and checked.agrees.all()
    elsewhere = dataclasses.replace(data, source={**data.source, "seed": 12})
    assert recompute(elsewhere).agrees.tolist() == [False, True, True, True]


def test_a_file_of_other_rewards_is_refused(grid):
    pools = {name: {"world": "crossing7"} for name in grid.mode_names}
    claims_default = dataclasses.replace(grid, source={**grid.source, "of": pools})
    with pytest.raises(UserError, match=r"15 of 15 episodes are not those of crossing7.*believe"):
        trusted(
            dataclasses.replace(claims_default, rewards=RewardPair(*(r + 1 for r in grid.rewards))),
            "FILE",
        )


@pytest.mark.parametrize(
    ("source", "reason"),
    [
        ({}, "names no world of ours"),
        ({"world": "mine:World"}, "names no world of ours"),
        ({"world": "crossing7 other"}, "names no world of ours"),
        ({"made_by": "with_images", "of": {"world": "crossing7"}}, "names no world of ours"),
        ({"made_by": "concatenate", "of": [{"world": "crossing7"}, {}]}, "names no world of ours"),
        (
            {"made_by": "concatenate", "of": [{"world": "crossing7"}, {"world": "crossing5"}]},
            "of several worlds",
        ),
        ({"world": "crossing5"}, "not those of crossing5"),
    ],
)
def test_what_cannot_be_checked_is_said(grid, source, reason):
    data = dataclasses.replace(grid, source=source)
    checked, (kept, line) = recompute(data), trusted(data, "FILE")
    assert reason in checked.reason and checked.agrees.all() and kept is data
    assert "FILE can't be recomputed" in line and reason in line and "data trust FILE" in line


def test_seeds_are_those_that_a_file_lists_and_never_more_than_can_be_driven():
    sources = [{"seeds": [7, 3, 7]}, {"seed": 10, "episodes": 10**18}, {"seeds": ["x"]}]
    seeds = _recorded_seeds(sources, 2)
    assert seeds[:3].tolist() == [3, 7, 10] and len(seeds) == MOST_SEEDS + 2
    assert _recorded_seeds([{"seed": -1}, {"seed": 2**70}], 2).size == 0
