import numpy as np
import pytest

from socialiq.audit.evidence.collect import collect_evidence
from socialiq.audit.evidence.drive import RANDOM, UniformPolicy
from socialiq.audit.evidence.outcomes import episode_seeds
from socialiq.types import Ending
from socialiq.worlds.world import ConstantPolicy


@pytest.fixture(scope="module")
def in_grid(declared):
    world = declared("crossing7").world()
    return collect_evidence(world, Standing(), episode_seeds(3, 50)).trivial


class Standing:
    """Chooses the first action."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.zeros(len(observation), np.int64), state


def test_a_gridworld_has_the_first_and_the_last_action_and_random_ones(in_grid):
    assert [one.name for one in in_grid] == ["trivial_STOP", "trivial_FAST", RANDOM]
    stop, fast, random = in_grid
    assert (stop.ending == Ending.TIMEOUT).all()
    assert (fast.length == 3).all()  # six cells, two a step
    assert len(set(random.length.tolist())) > 3


def test_the_first_action_drives_as_a_policy_that_chooses_it(declared):
    world = declared("crossing7").world()
    found = collect_evidence(world, Standing(), episode_seeds(3, 20))
    assert found.trivial[0].totals == pytest.approx(found.policy.totals, abs=0)


def test_random_actions_depend_on_the_seed_of_the_episode_alone(declared):
    seeds = episode_seeds(5, 40)
    for name in ("crossing7", "intersection"):
        world = declared(name).world()
        all_at_once, later = (
            collect_evidence(world, Standing(), one) for one in (seeds, seeds[25:])
        )
        whole, part = (one.trivial[-1].totals for one in (all_at_once, later))
        assert whole[25:].tolist() == part.tolist()
        assert len(np.unique(whole, axis=0)) > 20


def test_policies():
    assert int(ConstantPolicy(2).predict(np.zeros(4))[0]) == 2
    uniform = UniformPolicy(4)
    assert uniform.probabilities(np.zeros((3, 7))).tolist() == [[0.25] * 4] * 3
    assert uniform.predict(np.zeros((3, 7)))[0].tolist() == [0, 0, 0]
