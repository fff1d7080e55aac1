import pytest

from socialiq.audit.look import Plan
from socialiq.audit.seeds import Commitment


@pytest.fixture(name="plan", scope="session")
def plan_fixture(declared):
    """Commitment of an owner; a byte of the policy makes another."""

    def plan(byte: int = 0, episodes: int = 500, **fields) -> Plan:
        profile = declared(**fields)
        commitment = Commitment(f"{byte:064x}", profile.sha256)
        return Plan(commitment, profile, episodes, False, ())

    return plan
