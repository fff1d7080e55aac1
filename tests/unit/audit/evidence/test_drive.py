"""Gridworld episodes: the same chance for everybody, sums as by hand, references exact."""

import numpy as np
import pytest

from socialiq.audit.evidence.collect import collect_evidence
from socialiq.audit.evidence.drive import RANDOM, Course, UniformPolicy, exact_optima
from socialiq.audit.evidence.outcomes import Reference
from socialiq.audit.seeds import episode_seeds
from socialiq.errors import UserError
from socialiq.evaluation.effects import expected_delay, measure
from socialiq.types import Ending
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.registry import make
from socialiq.worlds.tabular_policy import TabularPolicy, expert_policy
from socialiq.worlds.world import ConstantPolicy


class Constant:
    """Answers one action, or whatever it is told to."""

    def __init__(self, action, n_features=None):
        self.action, self.seen, self.memories = action, [], []
        if n_features:
            self.n_features = n_features

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        self.seen.append(observation)
        self.memories.append((state, episode_start))
        count = 0 if state is None else state
        return np.full(len(observation), self.action), count + 1


def expert(table, angle):
    return TabularPolicy(table.world, expert_policy(table, angle))


def drive(world, policy, seeds, name="driver"):
    return Course(world, seeds).drive(Reference(name, policy))


@pytest.fixture(scope="module")
def world7(table7):
    return table7.world


SEEDS = episode_seeds(0, 400)


def test_the_5x5_experts_by_hand(table5):
    # Crossing at once earns the ego 6 of GGGG; the other, cut off, has paid 4 of its steps.
    egoist = drive(table5.world, expert(table5, 0.0), SEEDS[:20])
    prosocial = drive(table5.world, expert(table5, 45.0), SEEDS[:20])
    assert egoist.totals.tolist() == [[6.0, -4.0]] * 20
    assert prosocial.totals.tolist() == [[5.0, 6.0]] * 20
    assert (
        egoist.episodes.length.tolist() == [4] * 20
        and prosocial.episodes.length.tolist() == [5] * 20
    )
    assert prosocial.episodes.arrival.all()


def test_waiting_for_ever_runs_out_of_time(table5):
    waits = drive(table5.world, Constant(0), SEEDS[:20])
    assert waits.episodes.ending.tolist() == [Ending.TIMEOUT] * 20
    assert waits.episodes.length.tolist() == [table5.world.horizon] * 20
    assert waits.totals[:, 0].tolist() == [-20.0] * 20


def test_exact_optima_do_what_they_are_expected_to(world7):
    optima = exact_optima(Course(world7, SEEDS))
    assert all(one.expected for one in optima)
    for one in optima:
        error = np.maximum(one.totals.std(axis=0, ddof=1), 0.05) / np.sqrt(len(SEEDS))
        assert (np.abs(one.totals.mean(axis=0) - one.expected) < 5 * error).all(), one.name
    # The published egoist of the 7x7 world (docs/worlds/crossing7.md).
    egoist = next(one for one in optima if one.angles[0] <= 0.0 <= one.angles[1])
    assert egoist.expected == pytest.approx((2.2, -2.0))


def test_chance_is_common_and_the_rest_is_not(table7, world7):
    once, again = (drive(world7, expert(table7, 45.0), SEEDS) for _ in range(2))
    reverse = drive(world7, expert(table7, 45.0), SEEDS[::-1])
    np.testing.assert_array_equal(once.totals, again.totals)
    np.testing.assert_array_equal(once.totals, reverse.totals[::-1])
    assert len(np.unique(once.totals[:, 1])) > 1


def test_a_memory_is_carried_and_begun(world7):
    policy = Constant(1)
    drive(world7, policy, SEEDS[:5])
    states = [state for state, _ in policy.memories]
    assert states == [None, *range(1, len(states))]
    assert [begins.tolist() for _, begins in policy.memories][:2] == [[True] * 5, [False] * 5]


def test_who_reads_a_clock_is_given_one(world7):
    features = world7.n_features
    plain, timed = Constant(1), Constant(1, features + 1)
    for policy in (plain, timed):
        drive(world7, policy, SEEDS[:4])
    assert {seen.shape for seen in plain.seen} == {(4, features)}
    assert [seen[0, -1] for seen in timed.seen] == list(range(len(timed.seen)))


@pytest.mark.parametrize("answer", [3, -1, 0.5])
def test_what_is_no_action_is_refused(world7, answer):
    with pytest.raises(UserError, match=r"foreign (chose|answered)"):
        drive(world7, Constant(answer), SEEDS[:4], "foreign")


def test_evidence_of_a_gridworld(declared, table7):
    world = declared("crossing7").world()
    seeds = episode_seeds(5, 60)
    handed = Reference("expert", expert(table7, 90.0), 90.0)
    found = collect_evidence(world, expert(table7, 0.0), seeds, [handed])
    assert found.references[-1].angles == (90.0,)
    assert found.references[0].name == "optimum_00"
    assert set(found.strata["density"]) == {"0", "1", "2 or more"}
    assert found.gains().shape == (len(found.references), 60, 2)
    names = [one.name for one in found.references]
    assert [one.name for one in found.without({names[0]}).references] == names[1:]


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
    assert stop.episodes.timeout.all()
    assert (fast.episodes.length == 3).all()  # six cells, two a step
    assert len(set(random.episodes.length.tolist())) > 3


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


EFFECTS = ("delay", "braking", "gap_below_1_s")


@pytest.mark.parametrize("name", ["intersection", "intersection-caused"])
def test_measuring_effects_changes_no_bit_of_the_episodes(name):
    world = make(name)
    driver, seeds = Reference("driver", world.driver("gap_3s")), SEEDS[:40]
    plain = Course(world, seeds).drive(driver)
    course = Course(world, seeds, side_by_side=16, measured=EFFECTS)
    found = course.drive(driver)
    assert found.drove_as(plain) and not plain.measured
    assert found.totals.tobytes() == plain.totals.tobytes()
    effects = measure(make("intersection-caused"), driver.policy, seeds)
    for column, expected in zip(
        EFFECTS, (effects.delay, effects.braking, effects.gap < 1.0), strict=True
    ):
        assert found.episodes[column].tolist() == expected.tolist()
    assert Course(world, seeds, measured=("braking",)).drive(driver).measured == ("braking",)
    if name.endswith("caused"):  # the same episodes as those that give the rewards
        assert effects.totals.social == pytest.approx(found.totals[:, 1])


def test_the_delay_of_a_gridworld_is_exact_on_average(world7):
    """Each step's is the expectation over chance, so that no more than 4 errors are left."""
    table, slow = tabulate(world7), 1
    chances = np.eye(3)[np.full((world7.horizon, len(world7.states())), slow)]
    course = Course(world7, SEEDS, measured=("delay",))
    found = course.drive(Reference("slow", ConstantPolicy(slow))).episodes["delay"]
    error = found.std() / len(found) ** 0.5
    assert error > 0
    assert abs(found.mean() - expected_delay(table, chances)) <= 4 * error
    optimum = exact_optima(course)[0]
    assert optimum.episodes["delay"].shape == (len(SEEDS),)
