"""Evidence at the intersection: the same seeds for everybody, labels from the seed alone."""

from types import SimpleNamespace

import numpy as np
import pytest

import socialiq.audit.evidence.drive as driving
from socialiq.audit.evidence.collect import (
    NO_CROSSING,
    collect_evidence,
    intersection_strata,
    strata_of,
)
from socialiq.audit.evidence.outcomes import Reference
from socialiq.audit.seeds import MOST_EPISODES, episode_seeds
from socialiq.errors import UserError
from socialiq.evaluation.episodes import episodes_of
from socialiq.types import Ending
from socialiq.worlds.intersection.policies import policy
from socialiq.worlds.intersection.world import Intersection
from socialiq.worlds.registry import make

SEEDS = episode_seeds(3, 40)


@pytest.fixture(scope="module")
def found(declared):
    world = declared("intersection").world()
    return collect_evidence(
        world, policy("gap_3s"), SEEDS, [Reference("gap_2s", policy("gap_2s"), 30.0)]
    )


def test_everybody_drives_the_same_episodes(found):
    assert [one.name for one in found.references] == ["go", "wait", "idm", "gap_2s"]
    for one in (*found.references, found.policy):
        rule = "gap_3s" if one.name == "policy" else one.name
        alone = episodes_of(Intersection().batch(7), policy(rule), SEEDS)
        np.testing.assert_array_equal(one.totals, np.stack(alone.totals, axis=1))
        np.testing.assert_array_equal(one.episodes.ending, alone.ending)
        np.testing.assert_array_equal(one.episodes.contact, alone.contact)
        np.testing.assert_array_equal(one.episodes.length, alone.length)
    assert found.references[-1].angles == (30.0,) and found.references[0].angles == ()


def test_collisions_are_either_the_egos_or_not(found):
    go = found.references[0]
    assert go.episodes.at_fault.any() and not (go.episodes.at_fault & go.episodes.struck).any()
    np.testing.assert_array_equal(
        go.episodes.at_fault | go.episodes.struck, go.episodes.ending == Ending.COLLISION
    )


def test_strata_do_not_depend_on_the_driver_or_the_batch(found, declared, monkeypatch):
    monkeypatch.setattr(driving, "SIDE_BY_SIDE", 7)
    again = collect_evidence(declared("intersection").world(), policy("wait"), SEEDS)
    assert set(found.strata) == {"density", "conflict", "right_of_way"}
    for name, labels in found.strata.items():
        np.testing.assert_array_equal(labels, again.strata[name])
        assert len(np.unique(labels)) > 1
    np.testing.assert_array_equal(found.references[1].totals, again.policy.totals)


def scene(*others):
    """An observation at the reset: the ego 40 m south, and others as (x, y, vx, vy) in m, m/s."""
    seen = np.zeros((10, 7), np.float32)
    for row, (x, y, vx, vy) in enumerate([(2.0, 40.0, 0.0, -10.0), *others]):
        seen[row] = [1, x / 100, y / 100, vx / 20, vy / 20, 1, 0]
    return seen.reshape(1, -1)


@pytest.mark.parametrize(
    ("others", "labels"),
    [
        ([], ("0 to 1", "none yet", NO_CROSSING)),
        ([(-30.0, 2.0, 8.0, 0.0)], ("0 to 1", "at once", "theirs")),
        ([(-2.0, -30.0, 0.0, 8.0)] * 2, ("2 to 3", "at once", "oncoming")),
        ([(-60.0, 2.0, 8.0, 0.0)] * 4, ("4 or more", "none yet", NO_CROSSING)),
        ([(30.0, -2.0, 8.0, 0.0)], ("0 to 1", "none yet", NO_CROSSING)),
        ([(-2.0, -30.0, 0.0, 8.0), (30.0, -2.0, -8.0, 0.0)], ("2 to 3", "at once", "theirs")),
    ],
)
def test_labels_by_hand(others, labels):
    found = intersection_strata(scene(*others))
    assert tuple(found[name][0] for name in ("density", "conflict", "right_of_way")) == labels


def in_a_gridworld(fate, chance):
    """Episodes of a gridworld whose draws are these; the last chance is that of a spawn."""
    table = SimpleNamespace(world=SimpleNamespace(chance=chance))
    batch = SimpleNamespace(
        reset=lambda _: None, save=lambda: SimpleNamespace(fate=fate), table=table
    )
    course = driving.Course(make("crossing7"), np.arange(len(fate)))
    course.batch = batch
    return course


def test_a_deterministic_gridworld_has_no_strata():
    assert strata_of(in_a_gridworld(np.zeros((2, 5)), (1.0,))) == {}
    fate = np.array([[0.9, 0.1, 0.1, 0.1, 0.1, 0.1, 0.9], [0.1, 0.75, 0.1, 0.65, 0.8, 0.1, 0.1]])
    labels = strata_of(in_a_gridworld(fate, (0.7, 0.3)))["density"]
    assert labels.tolist() == ["0", "2 or more"]


def test_seeds_are_drawn_and_not_counted():
    seeds = episode_seeds(0, 5000)
    assert len(set(seeds.tolist())) == 5000 and seeds.min() > 1_000_000
    np.testing.assert_array_equal(seeds, episode_seeds(0, 5000))
    assert not set(seeds.tolist()) & set(episode_seeds(1, 5000).tolist())


@pytest.mark.parametrize(("seed", "episodes"), [(-1, 20), (0, 19), (0, MOST_EPISODES + 1)])
def test_what_can_not_be_drawn_is_refused(seed, episodes):
    with pytest.raises(UserError, match="must be"):
        episode_seeds(seed, episodes)


def test_a_policy_that_is_good_on_the_default_seeds_only_is_seen(declared):
    """It recognises episodes 0, 1, 2, ... by their first observation, and rams on elsewhere."""
    known = {row.tobytes() for row in Intersection().batch(64).reset(0)}

    class Tuned:
        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            careful, careless = (policy(name).predict(observation)[0] for name in ("wait", "go"))
            default = np.array([row.tobytes() in known for row in observation])
            return np.where(default, careful, careless), state

    world = declared("intersection").world()
    default = collect_evidence(world, Tuned(), np.arange(64))
    drawn = collect_evidence(world, Tuned(), episode_seeds(0, 64))
    first = [one.policy.totals[:, 0].mean() for one in (default, drawn)]
    assert abs(first[0] - first[1]) > 1.0
    np.testing.assert_array_equal(drawn.policy.totals, drawn.references[0].totals)
