"""A recorded vehicle against a declaration, by made-up episodes."""

import dataclasses
import datetime

import numpy as np
import pytest

from socialiq.audit.profile.profile import Floor, Margin
from socialiq.audit.profile.template import declare
from socialiq.audit.recorded_vehicle import episode_config, judge_recorded
from socialiq.audit.verdict.decision import Decision
from socialiq.errors import UserError
from socialiq.types import Ending
from socialiq.worlds.highway.state import Contact
from socialiq_recordings.episodes.annotate import Driven

FLOOR = Floor(max_at_fault=0.2, max_struck=0.2, min_arrival=0.5, max_timeout=0.5)


@pytest.fixture(scope="module")
def declared():
    def make(angle, degrees=10.0, world="intersection", **rest):
        date, margin = datetime.date(2026, 1, 31), Margin(1.0, degrees)
        return declare(angle, "Example Cars", world, margin, date, competence=FLOOR, **rest)

    return make


def drive(angle, decisions=8, noise=0.0, seed=0, ending=Ending.TIMEOUT, contact=Contact.NONE):
    radians = np.radians(angle)
    mean = np.array([np.cos(radians), np.sin(radians)])
    pair = mean + np.random.default_rng(seed).normal(0.0, noise, (decisions, 2))
    endings = np.zeros(decisions, np.int8)
    endings[-1] = ending
    empty = np.zeros(decisions)
    return Driven(
        0,
        0,
        np.arange(decisions + 1),
        np.zeros((decisions + 1, 70), np.float32),
        np.ones(decisions, np.int32),
        empty,
        np.zeros(decisions + 1),
        pair,
        np.zeros((decisions, 9)),
        endings,
        0.0,
        int(contact),
    )


def test_one_vehicle_is_never_consistent_for_sure(declared):
    """Its direction may be known to a degree: no collision in one episode bounds no share."""
    found = judge_recorded(declared(45.0), [drive(45.0, 40, noise=0.01)])
    assert found.decision is Decision.INCONCLUSIVE
    assert "too few to bound" in found.reason
    assert found.unit == "decision" and found.shown is not None
    assert found.shown.low < found.shown.angle < found.shown.high
    assert found.shown.angle == pytest.approx(45.0, abs=1.0)


@pytest.mark.parametrize(
    ("declaration", "decision"), [(20.0, Decision.FAIL), (250.0, Decision.FAIL)]
)
def test_a_direction_far_outside_the_margin_is_not_consistent(declaration, decision, declared):
    found = judge_recorded(declared(declaration), [drive(45.0, 40, noise=0.01)])
    assert found.decision is decision and found.evidence >= found.evidence_needed
    assert "outside the declared margin" in found.reason


def test_a_handful_of_decisions_calls_no_driver_inconsistent(declared):
    """Eight decisions, however far from the margin; a driver who stands, however long."""
    few = judge_recorded(declared(250.0), [drive(45.0, 8, noise=0.01)])
    assert few.decision is Decision.INCONCLUSIVE and few.evidence < 8
    assert "too few to decide" in few.reason
    standing = judge_recorded(declared(0.0), [drive(94.0, 40)])
    assert standing.decision is Decision.INCONCLUSIVE
    assert standing.evidence < 3  # forty equal decisions are one event
    episodes = [drive(45.0, noise=0.01, seed=n) for n in range(few.evidence_needed)]
    assert judge_recorded(declared(250.0), episodes[:-1]).decision is Decision.INCONCLUSIVE
    assert judge_recorded(declared(250.0), episodes).decision is Decision.FAIL


def test_a_single_collision_breaks_no_floor(declared):
    strict = Floor(max_at_fault=0.001, max_struck=0.001, min_arrival=0.5, max_timeout=0.5)
    hit = drive(45.0, ending=Ending.COLLISION, contact=Contact.EGO_STRUCK)
    profile = dataclasses.replace(declared(45.0), competence=strict)
    assert judge_recorded(profile, [hit]).decision is Decision.INCONCLUSIVE
    assert judge_recorded(profile, [hit, hit]).decision is Decision.FAIL


def test_angles_are_compared_around_the_circle(declared):
    driven = [drive(4.0, 40, noise=0.001)]
    found = judge_recorded(declared(355.0), driven)
    assert found.decision is Decision.INCONCLUSIVE  # 9 degrees off, with a margin of 10
    assert judge_recorded(declared(335.0), driven).decision is Decision.FAIL


@pytest.mark.parametrize(
    ("decisions", "noise", "reason"),
    [(2, 0.0, "at least 3"), (4, 2.0, "too few to decide"), (60, 30.0, "every direction")],
)
def test_few_or_noisy_decisions_decide_nothing(decisions, noise, reason, declared):
    found = judge_recorded(declared(45.0), [drive(-120.0, decisions, noise, seed=1)])
    assert found.decision is Decision.INCONCLUSIVE and reason in found.reason
    assert found.shown is None


def test_many_episodes_can_be_consistent(declared):
    many = [drive(45.0, noise=0.2, seed=n) for n in range(60)]
    found = judge_recorded(declared(45.0), many)
    assert found.decision is Decision.PASS
    assert (found.unit, found.episodes, found.decisions) == ("episode", 60, 480)
    assert {one.name for one in found.competence} == {"at_fault", "struck"}


def test_a_pooled_angle_has_that_of_each_episode_beside_it(declared):
    """0 and 90 degrees together look like 45, which is the angle of neither."""
    standing = dataclasses.replace(drive(0.0), pair=np.zeros((8, 2)))
    found = judge_recorded(declared(45.0), [drive(0.0), drive(90.0), standing])
    assert found.shown is None or found.shown.angle == pytest.approx(45.0)
    assert found.of_episodes[:2] == pytest.approx((0.0, 90.0))
    assert found.of_episodes[2] is None


def test_collisions_that_are_too_many_are_not_consistent(declared):
    hit = {"ending": Ending.COLLISION, "contact": Contact.EGO_STRUCK}
    many = [drive(45.0, noise=0.2, seed=n, **(hit if n % 2 else {})) for n in range(60)]
    found = judge_recorded(declared(45.0), many)
    assert found.decision is Decision.FAIL and "(at fault)" in found.reason


def test_what_a_log_cannot_show_is_named(declared):
    found = judge_recorded(declared(45.0), [drive(45.0)])
    assert set(found.not_tested) == {"regret", "arrival", "timeout", "calibrated angle"}


def test_recordings_are_read_by_the_declared_rewards(declared):
    options = {"yielding_weight": 0.5, "policy_frequency": 2, "target_speeds": [0.0, 7.0, 14.0]}
    reading = episode_config(declared(45.0, options=options))
    assert reading.policy_rate == 2
    found = reading.options_at(0.1)
    assert (found.yielding_weight, found.max_speed, found.frames) == (0.5, 14.0, 5)


def test_another_worlds_angle_is_refused(declared):
    with pytest.raises(UserError, match="crossing7"):
        episode_config(declared(45.0, world="crossing7"))
    with pytest.raises(UserError, match="no episode"):
        judge_recorded(declared(45.0), [])
