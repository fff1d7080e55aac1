"""The shift check: other traffic, differences with intervals, one sentence."""

import numpy as np
import pytest

from socialiq.audit.profile.profile import Floor, other_traffic
from socialiq.audit.verdict.decision import Decision
from socialiq.audit.verdict.results import Shift, changes, sentence_of, shift_of
from socialiq.errors import UserError
from socialiq.types import Ending
from socialiq.worlds.intersection.world import Intersection

ARRIVED, CRASHED = Ending.ARRIVAL, Ending.COLLISION


def made(outcomes, evidence, lost, crashes, episodes=100):
    """A policy that earns `lost` less than the best reference, and drives into others."""
    noise = np.tile([-0.5, 0.5], episodes // 2)
    kinds = [CRASHED] * crashes + [ARRIVED] * (episodes - crashes)
    touched = [1] * crashes + [0] * (episodes - crashes)
    totals = np.stack([noise - lost, np.zeros(episodes)], axis=1)
    policy = outcomes("policy", totals, kinds, touched)
    zero = np.zeros((episodes, 2))
    return evidence(policy, outcomes("good", zero), outcomes("worse", zero - 5.0))


def by_measure(found):
    return {one.measure: one for one in found}


def test_changes_by_hand(outcomes, evidence):
    here, there = made(outcomes, evidence, 1.0, 5), made(outcomes, evidence, 3.0, 30)
    found = by_measure(changes(here, there, 0.0, 0.95))
    assert found["regret"].declared == pytest.approx(1.0)
    assert found["regret"].change == pytest.approx(2.0)
    # The standard error is sqrt(2 * (0.25 * 100 / 99) / 100), times 1.972 of 198 degrees.
    assert found["regret"].low == pytest.approx(2.0 - 1.972017 * (2 * 0.25 / 99) ** 0.5)
    assert found["at_fault"].change == pytest.approx(0.25)
    assert found["arrival"].change == pytest.approx(-0.25)
    assert found["at_fault"].shown and found["arrival"].shown and found["regret"].shown
    assert not found["struck"].shown and found["struck"].low < 0.0 < found["struck"].high
    assert found["at_fault"].reference == 0.0 and found["regret"].reference is None


def test_traffic_of_the_worlds(declared):
    found = other_traffic(declared("intersection"))
    assert [dict(one.options) for one in found] == [
        {"population": "thesis"},
        {"connected_lanes": True},
    ]
    options = {"population": "thesis", "connected_lanes": True, "duration": 30.0}
    found = other_traffic(declared("intersection", options=options))
    assert [dict(one.options) for one in found] == [
        {"population": "highway_env"},
        {"connected_lanes": False},
    ]
    worlds = [one.world for one in found]
    assert all(isinstance(one, Intersection) and one.options.duration == 30.0 for one in worlds)
    for usual, other in ((0.3, 0.6), (0.7, 0.3), (0.0, 0.3)):
        profile = declared("crossing7", options={"spawn_probability": usual})
        assert [dict(one.options) for one in other_traffic(profile)] == [
            {"spawn_probability": other}
        ]
    with pytest.raises(UserError, match="leave out --shift"):
        other_traffic(declared("crossing5"))


@pytest.mark.parametrize("name", ["intersection", "merge"])
def test_shifts_of_a_road_are_other_traffic(declared, name):
    late, unseen = other_traffic(declared(name), ["late", "unseen=.3"])
    assert late.options == {"shift": "late"} and unseen.name == "the shift unseen=.3"
    assert late.world.description != unseen.world.description
    simulator = late.world.batch(1)
    simulator.reset([3])
    assert np.shape(simulator.observation) == (1, late.world.n_features)


def test_a_gridworld_has_no_shifts(declared):
    with pytest.raises(UserError, match="crossing7 is no road"):
        other_traffic(declared("crossing7"), ["late"])


def test_what_the_declaration_would_say_there(declared, outcomes, evidence):
    floor = Floor(max_at_fault=0.2, max_struck=1.0, min_arrival=0.0, max_timeout=1.0)
    profile = declared(
        "crossing7", 0.0, margin=type(declared().margin)(2.0, 10.0), competence=floor
    )
    traffic = other_traffic(profile)
    here, there = made(outcomes, evidence, 1.0, 5), made(outcomes, evidence, 3.0, 5)
    (found,) = shift_of(profile, here, traffic, [there], 0, resamples=200)
    assert found.decision is Decision.FAIL and found.best == "good" and found.episodes == 100
    assert [one.measure for one in found.significant] == ["regret"]
    assert sentence_of((found,)) == (
        "In other traffic it drives differently. With vehicles spawning at 0.6 a step: regret is 2 "
        "more."
    )
    (same,) = shift_of(profile, here, traffic, [here], 0, resamples=200)
    assert same.significant == () and same.decision is Decision.PASS
    assert sentence_of((same,)) == (
        "In other traffic (vehicles spawning at 0.6 a step) its driving does not change "
        "significantly."
    )


def test_the_sentence_names_what_changed_and_where(outcomes, evidence):
    here, there = made(outcomes, evidence, 1.0, 5), made(outcomes, evidence, 1.0, 30)
    moved = Shift("fog", {}, "00" * 32, 100, Decision.FAIL, "good", changes(here, there, 0.0, 0.95))
    still = Shift("rain", {}, "00" * 32, 100, Decision.PASS, "good", changes(here, here, 0.0, 0.95))
    assert sentence_of((moved, still)) == (
        "In other traffic it drives differently. With fog: it drives into another more "
        "often, by 25 points, it arrives less often, by 25 points. No significant change: rain."
    )


def test_chance_alone_is_seldom_taken_for_a_change(outcomes, evidence):
    """Two hundred policies that change nothing: at 95 % of each interval, 5 % of each differ."""
    rng = np.random.default_rng(0)
    shown = {"regret": 0, "at_fault": 0, "arrival": 0}
    for _ in range(200):
        pair = []
        for _ in range(2):
            kinds = np.where(rng.random(80) < 0.2, CRASHED, ARRIVED)
            policy = outcomes("p", rng.normal(size=(80, 2)), kinds, kinds == CRASHED)
            pair.append(evidence(policy, outcomes("r", np.zeros((80, 2)))))
        found = by_measure(changes(pair[0], pair[1], 0.0, 0.95))
        for name in shown:
            shown[name] += found[name].shown
    assert all(2 <= count <= 20 for count in shown.values()), shown
