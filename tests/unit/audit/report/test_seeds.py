"""Sections on seed and look: there and back, and contradictions in them."""

import dataclasses

import pytest

from socialiq.audit.look import Look, Opened, spend
from socialiq.audit.report.content import seeds_of
from socialiq.audit.report.recompute import faults_of_seeds, opened_of
from socialiq.audit.seeds import Commitment, Nonce, Round, draw, reveal
from socialiq.to_json import to_json

COMMITMENT = Commitment("ab" * 32, "cd" * 32)
LOOK = Look(2, 0.05 / 6, "cars.jsonl", "00" * 32, "11" * 32, "2023-08-23T15:00:00+00:00")
NONCE, ROUND = Nonce("5a" * 32), Round(1000, "aa" * 48)


def report_of(drawn, look=LOOK):
    """The parts of a report that concern its seed."""
    return to_json(
        {
            "declaration": {"confidence": 0.95},
            "verdict": {"error": 0.05 if look is None else look.error},
            "hashes": {"policy": COMMITMENT.policy_sha256, "profile": COMMITMENT.profile_sha256},
            "seeds": seeds_of(drawn, 500),
            "look": look,
        }
    )


@pytest.fixture(autouse=True)
def every_round_is_genuine(monkeypatch):
    monkeypatch.setattr(Round, "is_genuine", lambda self: self == ROUND)


DRAWS = {
    "entropy": draw(COMMITMENT),
    "seed": draw(COMMITMENT, 7),
    "nonce": reveal(COMMITMENT, LOOK.entry, NONCE),
    "beacon": reveal(COMMITMENT, LOOK.entry, ROUND),
}


@pytest.mark.parametrize("source", ["entropy", "nonce", "beacon"])
def test_seed_and_look_are_read_back(source):
    drawn = DRAWS[source]
    report = report_of(drawn)
    assert opened_of(report) == Opened(drawn, LOOK)
    assert faults_of_seeds(report) == []


def test_without_a_log_the_error_is_the_whole():
    report = report_of(DRAWS["seed"], None)
    assert opened_of(report).look is None and faults_of_seeds(report) == []


@pytest.mark.parametrize(
    ("source", "section", "changes", "fault"),
    [
        ("entropy", "look", {"error": 0.05}, "the error of look 2 is not its share"),
        ("entropy", "look", {"number": 1}, "the error of look 1 is not its share"),
        ("entropy", "verdict", {"error": 0.05}, "the error of the verdict is not that of the look"),
        ("entropy", "seeds", {"source": "auditor's seed"}, "whose seed was known before"),
        ("entropy", "seeds", {"worth": "Chosen by chance."}, "are not those of its source"),
        ("entropy", "seeds", {"source": "beacon"}, "there is no beacon"),
        ("nonce", "seeds", {"source": "system entropy"}, "does not follow from commitment"),
        ("nonce", "seeds", {"seed": 8}, "does not follow from commitment and auditor's nonce"),
        ("nonce", "look", {"entry": "22" * 32}, "does not follow from commitment"),
        ("beacon", "seeds", {"seed": 8}, "does not follow from commitment and beacon"),
        ("beacon", "look", {"committed": "2026-01-31T12:00:00+00:00"}, "published before the"),
        ("beacon", "look", {"committed": "2023-02-31T12:00:00+00:00"}, "published before the"),
    ],
)
def test_contradictions_are_found(source, section, changes, fault):
    report = report_of(DRAWS[source])
    report[section] |= changes
    assert fault in " ".join(faults_of_seeds(report))


def test_a_round_that_the_beacon_did_not_sign_is_found():
    other = reveal(COMMITMENT, LOOK.entry, Round(1000, "bb" * 48))
    assert faults_of_seeds(report_of(other)) == ["report.json: the beacon did not sign this round"]


def test_a_nonce_without_a_log_is_found():
    report = report_of(DRAWS["nonce"], None)
    assert "needs a log" in " ".join(faults_of_seeds(report))


def test_other_looks_have_other_shares():
    for number in (1, 2, 7):
        look = dataclasses.replace(LOOK, number=number, error=spend(0.05, number))
        assert faults_of_seeds(report_of(DRAWS["entropy"], look)) == []
