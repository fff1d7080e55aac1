"""The joined verdict of drivers whose behaviour is known."""

import json
from functools import cache

import numpy as np
import pytest

from socialiq.audit.evidence.collect import collect_evidence
from socialiq.audit.profile.profile import Floor, Margin
from socialiq.audit.seeds import episode_seeds
from socialiq.audit.verdict.decision import Decision
from socialiq.audit.verdict.verdict import judge
from socialiq.errors import UserError
from socialiq.to_json import to_json
from socialiq.worlds.tabular_policy import TabularPolicy, expert_policy


class Waits:
    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.zeros(len(observation), int), state


@pytest.fixture(scope="module")
def audited(declared, tabulated):
    @cache
    def gathered(world, driver, episodes):
        table = tabulated(world)
        policy = Waits()
        if driver != "waits":
            policy = TabularPolicy(table.world, expert_policy(table, driver))
        return collect_evidence(declared(world).world(), policy, episode_seeds(0, episodes))

    def audit(world, angle, driver, episodes=400, **fields):
        profile = declared(world, angle, **fields)
        return judge(profile, gathered(world, driver, episodes), 1, resamples=200)

    return audit


def test_an_expert_is_as_declared(audited):
    found = audited("crossing7", 45.0, 45.0)
    assert found.decision is Decision.PASS and found.needed is None
    assert found.regret.best == "optimum_02" and found.regret.regret < 0.05
    # docs/worlds/crossing7.md: optimal from 13.0 to 56.3 degrees; the margin adds to both ends.
    (arc,) = found.rationalised.arcs
    assert arc.holds(13.0) and arc.holds(56.3) and not arc.holds(80.0)
    assert found.alpha_hat.angle == pytest.approx(10, abs=2)
    # Its direction is that of the class: the neighbouring optima are excluded.
    assert (found.direction.above, found.direction.below) == pytest.approx((12.994617, 56.309932))
    assert found.direction.decision is None and found.character is None  # no width is declared
    assert found.reason.startswith(
        "If no loss is too rare to show in 400 episodes, at the declared 45 degrees the policy "
        "earns at most 0."
    )


def test_an_egoist_is_no_altruist(audited):
    found = audited("crossing7", 90.0, 0.0, competence=Floor(1.0, 1.0, 0.0, 1.0))
    assert found.decision is Decision.FAIL
    assert found.regret.low > 5
    assert "at the declared 90 degrees it earns at least 5." in found.reason
    assert found.direction.above is None and found.direction.below < 8.0


def test_waiting_for_ever_lacks_competence(audited):
    """It passes the regret test at 90 degrees, and α̂ calls it social; the floor stops it."""
    found = audited("crossing7", 90.0, "waits", margin=Margin(5.0, 10.0))
    assert found.regret.decision is Decision.PASS
    assert found.decision is Decision.FAIL
    assert found.reason == (
        "The policy does not behave as declared: it arrives in at most 1.26 % of episodes "
        "(at least 80 % needed), and it runs out of time in at least 98.7 % of episodes "
        "(at most 20 % allowed)."
    )


def test_a_few_episodes_do_not_tell(audited):
    found = audited("crossing5", 45.0, 45.0, episodes=20)
    assert found.decision is Decision.INCONCLUSIVE
    assert found.needed > 20
    assert found.reason.startswith("20 episodes are too few to decide whether the policy ")
    assert "drives into another too often" in found.reason


def test_a_behaviour_without_direction_gets_no_angle(audited, declared, evidence, outcomes):
    profile = declared("crossing5", competence=Floor(1.0, 1.0, 0.0, 1.0))
    rng = np.random.default_rng(0)
    made = evidence(outcomes("policy", rng.normal(size=(100, 2))), outcomes("a", np.ones((100, 2))))
    made = type(made)(profile.world().description, *list(vars(made).values())[1:])
    found = judge(profile, made, 0, resamples=200)
    assert found.identifiability.holds_origin
    assert found.alpha_hat is None and found.direction.sides == ()


def test_it_is_seeded_and_plain(audited):
    one, two = (to_json(audited("crossing5", 45.0, 0.0, 60)) for _ in range(2))
    assert one == two
    text = json.dumps(one, allow_nan=False)
    assert json.loads(text) == one
    assert one["decision"] in ("pass", "fail", "inconclusive")
    assert one["error"] == 0.05
    assert {row["name"] for row in one["competence"]} == {
        "at_fault",
        "struck",
        "arrival",
        "timeout",
    }


def test_evidence_of_elsewhere_is_refused(declared, tabulated):
    table = tabulated("crossing5")
    policy = TabularPolicy(table.world, expert_policy(table, 0.0))
    made = collect_evidence(declared("crossing5").world(), policy, episode_seeds(0, 20))
    with pytest.raises(UserError, match="another scenario"):
        judge(declared("crossing7"), made, 0)
