"""Direction and single character, on drivers along a made-up front of the angles."""

import datetime
from dataclasses import replace

import numpy as np
import pytest

from socialiq import UserError
from socialiq.audit.profile.profile import Clip, Floor, Margin
from socialiq.audit.profile.template import declare
from socialiq.audit.verdict.decision import Decision
from socialiq.audit.verdict.direction import (
    character_test,
    direction_test,
    driver_of,
    drivers_of,
    ends_of,
)
from socialiq.audit.verdict.verdict import decide

ANGLES = np.arange(0.0, 91.0, 15.0)
CLIP = Clip((-8.0, 12.0), (-12.0, 12.0))
OPEN = Floor(1.0, 1.0, 0.0, 1.0)
EPISODES = 1000


def on_front(angle, rng, spread=0.5):
    """Totals of the driver of an angle in degrees: the front is a quarter of a circle."""
    radians = np.deg2rad(angle)
    mean = 4.0 * np.array([np.cos(radians), np.sin(radians)])
    return mean + spread * rng.normal(size=(EPISODES, 2))


@pytest.fixture(scope="module")
def line(outcomes):
    """The dial of a made-up world, the same in every test."""
    rng = np.random.default_rng(5)
    return [outcomes(f"dial_{a:g}", on_front(a, rng), angles=(a,)) for a in ANGLES]


@pytest.fixture
def audit(line, outcomes, evidence):
    def drive(declared, totals, margin=None):
        margin = margin or Margin(0.5, None, None, 15.0, 0.075)
        day = datetime.date(2026, 1, 31)
        profile = declare(declared, "o", "intersection", margin, day, competence=OPEN, clip=CLIP)
        return profile, evidence(outcomes("policy", totals), *line)

    return drive


def mixture(rng, share, egoist, altruist):
    first = rng.random(EPISODES) < share
    return np.where(first[:, None], on_front(egoist, rng), on_front(altruist, rng))


@pytest.mark.parametrize(
    ("declared", "true", "decision"),
    [
        (45.0, 45.0, Decision.PASS),
        (45.0, 40.0, Decision.PASS),
        (45.0, 0.0, Decision.FAIL),  # the egoist
        (45.0, 75.0, Decision.FAIL),
        (0.0, 45.0, Decision.FAIL),
        (75.0, 45.0, Decision.FAIL),
        (0.0, 0.0, Decision.PASS),
        (90.0, 90.0, Decision.PASS),
        (45.0, 30.0, Decision.INCONCLUSIVE),  # on the end: never shown to be within
    ],
)
def test_a_driver_of_an_angle_passes_there_and_not_elsewhere(audit, declared, true, decision):
    profile, driven = audit(declared, on_front(true, np.random.default_rng(1)))
    found = direction_test(profile, driven, 0.05, 0.0125)
    assert found.decision is decision
    if declared == true == 45.0:
        assert (found.low, found.high, found.above, found.below) == (30.0, 60.0, 30.0, 60.0)


def test_a_margin_of_regret_alone_lets_a_neighbour_pass(audit):
    """The driver of 30 degrees loses .14 at 45; without a width it passes, with one it doesn't."""
    totals = on_front(30.0, np.random.default_rng(2))
    for margin, decision in (
        (Margin(0.5), Decision.PASS),
        (Margin(0.5, None, None, 15.0), Decision.INCONCLUSIVE),
    ):
        profile, driven = audit(45.0, totals, margin)
        assert decide(profile, driven, 0, 200, 0.05).decision is decision


def test_half_egoists_have_not_one_character(audit):
    """Half of the episodes at 0 degrees, half at 90: the mean is that of 45."""
    totals = mixture(np.random.default_rng(3), 0.5, 0.0, 90.0)
    profile, driven = audit(45.0, totals)
    assert direction_test(profile, driven, 0.05, 0.0125).decision is Decision.PASS
    found = character_test(profile, driven, 0.05, 0.0125)
    assert found.decision is Decision.FAIL
    assert all(side.low > 0.3 for side in found.beyond)
    one = audit(45.0, on_front(45.0, np.random.default_rng(4)))
    assert character_test(*one, 0.05, 0.0125).decision is Decision.PASS


def test_where_no_share_is_declared_nothing_is_tested(audit):
    profile, driven = audit(45.0, on_front(45.0, np.random.default_rng(4)), Margin(0.5))
    assert character_test(profile, driven, 0.05, 0.0125) is None
    found = direction_test(profile, driven, 0.05, 0.0125)
    assert found.decision is None and (found.above, found.below) == (30.0, 60.0)


@pytest.mark.slow
def test_wrong_passes_on_an_end_of_the_width_come_in_five_percent(audit):
    """Of 300 policies with D = 0 at the lower end at most 9.4 % pass: 5 % and 3.5 errors."""
    wrong = 0
    for number in range(300):
        profile, driven = audit(45.0, on_front(30.0, np.random.default_rng(number)))
        own = driven.policy.totals
        own += driven.references[2].totals.mean(0) - own.mean(0)
        noise = np.random.default_rng(10_000 + number).normal(size=2) * 0.5 * (2 / EPISODES) ** 0.5
        own += noise
        policy = driven.policy.with_columns(r_env=own[:, 0], r_social=own[:, 1])
        driven = replace(driven, policy=policy)
        found = direction_test(profile, driven, 0.05, 0.0125, ends_only=True)
        wrong += found.decision is Decision.PASS
    assert wrong <= 28


def test_the_reference_driver_is_the_first_of_its_angle(outcomes):
    one, two = (outcomes(name, [[0.0, 0.0]], angles=(45.0,)) for name in ("dial_45", "other"))
    assert driver_of(drivers_of([one, two]), 45.0).outcomes is one
    assert driver_of(drivers_of([two, one]), 45.0).outcomes is two
    assert driver_of(drivers_of([one]), 30.0) is None
    assert drivers_of([outcomes("none", [[0.0, 0.0]])]) == []


def test_a_class_of_angles_has_one_driver(outcomes):
    """The optima of a gridworld: the ends of 45 degrees are in the next classes."""
    ends = [(-40.0, 7.8), (7.8, 13.0), (13.0, 56.3), (56.3, 61.4), (61.4, 200.0)]
    optima = [outcomes(f"optimum_{k}", [[0.0, 0.0]], angles=at) for k, at in enumerate(ends)]
    drivers = drivers_of(optima)
    assert drivers[0][:2] == (0.0, 7.8)
    assert drivers[-1][:2] == (61.4, 90.0)
    assert ends_of(drivers, 45.0, 15.0) == [0.0, 60.0]
    assert ends_of(drivers, 0.0, 15.0) == [None, 15.0]
    assert ends_of(drivers, 75.0, 15.0) == [60.0, None]


def test_without_a_reference_of_an_end_the_policy_does_not_pass(audit, evidence):
    profile, driven = audit(45.0, on_front(45.0, np.random.default_rng(1)))
    few = evidence(driven.policy, *driven.references[3:])
    found = direction_test(profile, few, 0.05, 0.0125)
    assert found.decision is Decision.INCONCLUSIVE and found.needed is None
    assert found.lacking == "no reference driver of 30 degrees"
    assert character_test(profile, few, 0.05, 0.0125).decision is Decision.INCONCLUSIVE


def test_a_width_without_limits_of_the_rewards_is_refused_in_one_line(audit):
    profile, driven = audit(45.0, on_front(45.0, np.random.default_rng(1)))
    scenario = replace(profile.scenario, world="merge")
    unlimited = replace(profile, scenario=scenario, clip=None)
    words = r"^margin.width needs limits of the rewards: add \[clip\]$"
    with pytest.raises(UserError, match=words):
        direction_test(unlimited, driven, 0.05, 0.0125)
    free = replace(unlimited, margin=replace(profile.margin, width=None))
    assert direction_test(free, driven, 0.05, 0.0125).sides == ()


def test_clipped_rewards_bound_the_loss(audit):
    """A loss of 1,000 in one episode counts as one of 20: the test has no episode beyond it."""
    totals = on_front(45.0, np.random.default_rng(1))
    totals[7] = (-1000.0, 0.0)
    profile, driven = audit(45.0, totals)
    assert profile.largest_loss == pytest.approx(31.113, abs=1e-3)
    assert [CLIP.largest_loss(angle) for angle in (0.0, 90.0)] == [20.0, 24.0]
    assert driven.clipped(profile.clip).policy.totals.min() == -8.0
    assert decide(profile, driven, 0, 200, 0.05).decision is Decision.PASS


def test_a_width_without_an_end_is_not_tested(audit):
    """Before, the egoist passed direction and character at 45 degrees with a width of 60."""
    totals = on_front(0.0, np.random.default_rng(1))
    profile, driven = audit(45.0, totals, Margin(0.5, None, None, 60.0, 0.075))
    found = direction_test(profile, driven, 0.05, 0.0125)
    assert (found.decision, found.needed) == (Decision.INCONCLUSIVE, None)
    assert "no end of the width" in found.lacking
    assert character_test(profile, driven, 0.05, 0.0125).decision is Decision.INCONCLUSIVE


def test_an_end_that_steps_over_the_last_angle_is_tested_at_it(outcomes):
    """Of the classes 0 to 3 and 3 to 90 degrees the end of 25 with a width of 15 is 0, not -5."""
    drivers = drivers_of(
        [outcomes(str(a), [[0.0, 0.0]], angles=a) for a in ((0.0, 3.0), (3.1, 90.0))]
    )
    assert ends_of(drivers, 25.0, 15.0) == [0.0, None]
