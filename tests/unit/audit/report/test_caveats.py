import pytest

from socialiq.audit.report.caveats import caveats
from socialiq.audit.seeds.commitment import Commitment, draw

COMMITMENT = Commitment("ab" * 32, "cd" * 32)


def about(seed: int | None, kind: str) -> list[str]:
    return [one.about for one in caveats(draw(COMMITMENT, seed), {"kind": kind})]


def test_a_seed_given_in_advance_is_a_caveat():
    assert about(7, "sb3") == ["seed"]
    assert about(None, "sb3") == []


@pytest.mark.parametrize("kind", ["python", "process"])
def test_the_owners_code_is_a_caveat(kind):
    assert about(None, kind) == ["code"]
