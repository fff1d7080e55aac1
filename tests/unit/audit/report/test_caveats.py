import pytest

from socialiq.audit.looks.look import Look
from socialiq.audit.report.caveats import caveats
from socialiq.audit.seeds.commitment import Commitment, Draw, draw, reveal
from socialiq.audit.seeds.nonce import Nonce
from socialiq.audit.verdict.decision import Decision
from socialiq.audit.verdict.discrimination import Discrimination, OtherDriver

COMMITMENT = Commitment("ab" * 32, "cd" * 32)
STRICT = Discrimination(1, 2, False, (OtherDriver("set_egoistic", False, Decision.PASS),))


LOOK = Look(3, 0.05 / 12, "cars.jsonl", "00" * 32, "11" * 32, "2026-01-31T12:00:00+00:00")


def texts(drawn: Draw, look: Look | None = None, kind: str = "sb3") -> dict[str, str]:
    return dict(caveats(drawn, look, {"kind": kind}, STRICT))


def test_log_and_seed_are_always_told():
    assert list(texts(draw(COMMITMENT), LOOK)) == ["look", "seed"]
    assert "No audit log was kept" in texts(draw(COMMITMENT))["look"]
    assert texts(draw(COMMITMENT), LOOK)["look"] == (
        "This is look 3 of this owner at this scenario by the audit log cars.jsonl, with an error "
        "of at most 0.417 %. Audits outside that log are not known."
    )


def test_the_worth_of_the_seed_is_told():
    assert "given in advance" in texts(draw(COMMITMENT, 7))["seed"]
    assert "self-attested" in texts(draw(COMMITMENT))["seed"]
    assert "nonce" in texts(reveal(COMMITMENT, "11" * 32, Nonce("22" * 32)))["seed"]


@pytest.mark.parametrize("kind", ["python", "process"])
def test_the_owners_code_is_a_caveat(kind):
    assert "code" in texts(draw(COMMITMENT), kind=kind)


def test_a_declaration_that_waiting_would_pass_is_a_caveat():
    drivers = (
        OtherDriver("go", True, Decision.FAIL),
        OtherDriver("wait", True, Decision.PASS),
        OtherDriver("trivial_random", True, Decision.INCONCLUSIVE),
        OtherDriver("set_egoistic", False, Decision.PASS),
    )
    loose = Discrimination(2, 4, False, drivers)
    found = caveats(draw(COMMITMENT), None, {"kind": "sb3"}, loose)[0]
    assert found.about == "margin"
    assert found.text == (
        "The declaration excludes little: 2 of 4 other drivers would pass it too, among them one "
        "that always waits."
    )
