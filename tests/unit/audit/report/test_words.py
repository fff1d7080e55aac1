import numpy as np
import pytest

from socialiq.audit.look import Look, draw, reveal, spend
from socialiq.audit.report.words import (
    caveats,
    caveats_of_episodes,
    caveats_of_loss,
    names_of,
    odds,
    plain_name,
    price,
)
from socialiq.audit.request import GAPS
from socialiq.audit.seeds import Commitment, Draw, Nonce
from socialiq.audit.verdict.regret import Regrets, regret_test
from socialiq.worlds.intersection.world import Intersection

COMMITMENT = Commitment("ab" * 32, "cd" * 32)

LOOK = Look(3, 0.05 / 12, "cars.jsonl", "00" * 32, "11" * 32, "2026-01-31T12:00:00+00:00")


def texts(
    drawn: Draw,
    look: Look | None = None,
    isolation: str = "not needed",
    world: str = "crossing7",
) -> dict[str, str]:
    record = {"isolation": {"kind": isolation, "why": "a reason"}}
    return dict(caveats(drawn, look, record, world))


def test_log_and_seed_are_always_told():
    assert list(texts(draw(COMMITMENT), LOOK)) == ["look", "seed"]
    assert "No audit log was kept" in texts(draw(COMMITMENT))["look"]
    assert texts(draw(COMMITMENT), LOOK)["look"] == (
        "This is look 3 of this owner at this scenario by the audit log cars.jsonl. Look 3 decides "
        "wrongly in at most 1 audit in 240; look 4 would in 1 audit in 400, and needs more "
        "episodes for the same decision. Audits outside that log are not known."
    )


@pytest.mark.parametrize(
    ("error", "words"), [(0.05, "20"), (0.025, "40"), (1e-4, "10,000"), (0.0, "1,000,000,000")]
)
def test_an_error_is_told_as_odds(error, words):
    assert odds(error) == f"1 audit in {words}"


@pytest.mark.parametrize("number", [1, 2, 7])
def test_the_price_of_the_next_look_is_its_share_of_the_error(number):
    said = price(number, spend(0.05, number))
    assert f"look {number + 1} would in {odds(spend(0.05, number + 1))}," in said


def test_the_worth_of_the_seed_is_told():
    assert "given in advance" in texts(draw(COMMITMENT, 7))["seed"]
    assert "self-attested" in texts(draw(COMMITMENT))["seed"]
    assert "nonce" in texts(reveal(COMMITMENT, "11" * 32, Nonce("22" * 32)))["seed"]


def test_code_that_was_not_isolated_is_a_caveat():
    assert "not isolated (a reason)" in texts(draw(COMMITMENT), isolation="none")["code"]
    assert "code" not in texts(draw(COMMITMENT), isolation="bubblewrap 0.8.0")


def test_the_scenarios_own_code_is_a_caveat():
    assert "auditor's process" in texts(draw(COMMITMENT), world="roads.py:make")["code"]
    assert "code" not in texts(draw(COMMITMENT), world="CartPole-v1")


@pytest.fixture(scope="module")
def tested(outcomes, evidence):
    """The policy's largest loss is 2.5, in one of 500 episodes."""
    totals = np.zeros((500, 2))
    behind = totals.copy()
    behind[7, 0] = -2.5
    made = evidence(outcomes("policy", behind), outcomes("a", totals))

    def with_loss(largest_loss):
        return regret_test(Regrets(made, 0, 100, largest_loss), 0.0, 1.0)

    return with_loss


def test_without_a_largest_loss_the_assumption_is_a_caveat(tested):
    (found,) = caveats_of_loss(tested(None), 40.0)
    assert found.about == "loss"
    # 1 - 0.05^(1 / 500)
    assert "one in 0.6 % of episodes, of whatever size, stays unseen in 5 % of audits" in found.text


def test_the_owners_statement_is_a_caveat_below_the_rewards_own_limits(tested):
    assert caveats_of_loss(tested(40.0), 40.0) == caveats_of_loss(tested(50.0), 40.0) == []
    (below,), (unknown,) = (caveats_of_loss(tested(30.0), one) for one in (40.0, None))
    assert "the owner's statement that no episode loses more than 30; the rewards allow 40" in (
        below.text
    )
    assert "more than 30; the limits of this environment's rewards are not known" in unknown.text
    assert unknown.text.endswith("The largest loss seen is 2.5.")


def test_episodes_that_were_others_when_run_again_are_a_caveat():
    assert caveats_of_episodes(6, 6) == [] == caveats_of_episodes(0, 0)
    (found,) = caveats_of_episodes(4, 6)
    assert found.about == "episodes"
    assert found.text.startswith("2 of 6 chosen episodes were others")


MODES = ("egoistic", "prosocial", "altruistic")


def test_every_driver_of_the_package_has_a_name_in_words():
    experts = [f"{kind}_{mode}" for kind in ("set", "expert") for mode in MODES]
    for name in (*Intersection.references, *GAPS, *experts):
        found = plain_name(name)
        assert found != name and "_" not in found
    assert plain_name("set_prosocial").startswith("trained for 45°")


def test_optima_are_named_by_their_angles():
    assert plain_name("optimum_03", (13.0, 56.31)) == "best possible for 13° to 56.3°"
    assert plain_name("optimum_04", (2.6, 191.2)) == "best possible for 2.6° to 90°"
    assert plain_name("optimum_05", (315.0, 365.7)) == "best possible for 0° to 5.7°"
    assert plain_name("optimum_06", (101.3, 191.3)) == "best possible for 101.3° to −168.7°"
    assert plain_name("optimum_20", (300.0, 370.0)) == "best possible for 0° to 10°"


def test_trivial_drivers():
    assert plain_name("trivial_random") == "chooses at random"
    assert plain_name("trivial_STOP") == "always chooses “STOP”"
    assert plain_name("trivial_action_0") == "always chooses “action 0”"


def reference(name, record=None):
    return {"name": name, "angles": [], "record": record}


def test_a_driver_of_the_user_keeps_its_name():
    file = {"kind": "policy", "source": "runs/go.safetensors"}
    report = {
        "references": [reference("go", file), reference("wait"), reference("gap_2s", RULE)],
        "trivial": [{"name": "trivial_random"}],
        "left_out": [reference("mine", file), reference("idm")],
    }
    assert names_of(report) == {
        "go": "go",
        "wait": "always waits",
        "gap_2s": "goes at gaps of 2 s",
        "trivial_random": "chooses at random",
        "mine": "mine",
        "idm": "Intelligent Driver Model: follows the car in front and gives way",
    }


RULE = {"kind": "rule", "source": "gap_2s"}
