import datetime
from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from socialiq.audit.evidence.outcomes import Evidence, Outcomes
from socialiq.audit.look import Plan
from socialiq.audit.profile.profile import Margin, Profile
from socialiq.audit.profile.template import declare
from socialiq.audit.seeds import Commitment
from socialiq.evaluation.measures import Episodes
from socialiq.types import Ending


def outcomes(
    name: str,
    totals: Sequence | np.ndarray,
    ending: Sequence[int] | None = None,
    contact: Sequence[int] | None = None,
    **fields: object,
) -> Outcomes:
    rows = np.array(totals, np.float64).reshape(-1, 2)
    kinds = np.full(len(rows), Ending.ARRIVAL) if ending is None else np.array(ending)
    touched = np.zeros(len(rows), np.int64) if contact is None else np.array(contact)
    columns = {"r_env": rows[:, 0], "r_social": rows[:, 1], "ending": kinds, "contact": touched}
    columns |= {"length": np.ones(len(rows), np.int64)} | fields.pop("beside", {})
    return Outcomes(name, Episodes(columns), **fields)


def evidence(policy: Outcomes, *references: Outcomes, **strata: np.ndarray) -> Evidence:
    return Evidence("made up", np.arange(len(policy.totals)), policy, references, strata)


def declared(world: str = "crossing5", angle: float = 45.0, **fields: object) -> Profile:
    options: Mapping = fields.pop("options", {})
    margin = fields.pop("margin", Margin(0.5, 10.0))
    day = datetime.date(2026, 1, 31)
    return declare(angle, "An owner", world, margin, day, options, **fields)


@pytest.fixture(name="outcomes", scope="session")
def outcomes_fixture():
    return outcomes


@pytest.fixture(name="evidence", scope="session")
def evidence_fixture():
    return evidence


@pytest.fixture(name="declared", scope="session")
def declared_fixture():
    return declared


@pytest.fixture(name="plan", scope="session")
def plan_fixture(declared):
    """Commitment of an owner; a byte of the policy makes another."""

    def plan(byte: int = 0, episodes: int = 500, **fields) -> Plan:
        profile = declared(**fields)
        commitment = Commitment(f"{byte:064x}", profile.sha256)
        return Plan(commitment, profile, episodes, False, ())

    return plan
