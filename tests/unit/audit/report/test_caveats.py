import pytest

from socialiq.audit.report.caveats import caveats
from socialiq.audit.seeds.commitment import Commitment, draw
from socialiq.audit.verdict.decision import Decision
from socialiq.audit.verdict.discrimination import Discrimination, OtherDriver

COMMITMENT = Commitment("ab" * 32, "cd" * 32)
STRICT = Discrimination(1, 2, False, (OtherDriver("set_egoistic", False, Decision.PASS),))


def about(seed: int | None, kind: str) -> list[str]:
    return [one.about for one in caveats(draw(COMMITMENT, seed), {"kind": kind}, STRICT)]


def test_a_seed_given_in_advance_is_a_caveat():
    assert about(7, "sb3") == ["seed"]
    assert about(None, "sb3") == []


@pytest.mark.parametrize("kind", ["python", "process"])
def test_the_owners_code_is_a_caveat(kind):
    assert about(None, kind) == ["code"]


def test_a_declaration_that_waiting_would_pass_is_a_caveat():
    drivers = (
        OtherDriver("go", True, Decision.FAIL),
        OtherDriver("wait", True, Decision.PASS),
        OtherDriver("trivial_random", True, Decision.INCONCLUSIVE),
        OtherDriver("set_egoistic", False, Decision.PASS),
    )
    loose = Discrimination(2, 4, False, drivers)
    (found,) = caveats(draw(COMMITMENT), {"kind": "sb3"}, loose)
    assert found.about == "margin"
    assert found.text == (
        "The declaration excludes little: 2 of 4 other drivers would pass it too, among them one "
        "that always waits."
    )
