"""A report recomputed from its table of episodes."""

import copy
import dataclasses
import json

import pytest

from socialiq.audit.look import Look, Opened, draw, reveal, spend
from socialiq.audit.report.content import content, seeds_of
from socialiq.audit.report.folder import evidence_path, files_of
from socialiq.audit.report.recompute import (
    audited_of,
    differences,
    differences_of,
    faults_of_seeds,
    opened_of,
)
from socialiq.audit.seeds import Commitment, Nonce, Round
from socialiq.errors import UserError
from socialiq.to_json import to_json


@pytest.fixture(scope="module")
def files(report, audited):
    return files_of(report, audited.profile, audited.evidence)


def recomputed_differences(files, read):
    return differences_of(audited_of(files, read), read)


@pytest.fixture
def read(files):
    return json.loads(files["report.json"])


def test_the_report_follows_from_its_episodes_to_the_last_digit(files, read):
    fresh = json.loads(json.dumps(content(audited_of(files, read))))
    for name in ("timing", "versions", "machine"):
        del fresh[name], read[name]
    assert fresh == read
    assert recomputed_differences(files, {**read, "timing": 0, "versions": 0, "machine": 0}) == []


def test_every_number_of_the_report_is_recomputed(files, read):
    """A number that is changed is found, wherever it is, but for what the auditor claims."""
    claimed = ("timing", "versions", "machine", "command", "reference_files", "claims_of_auditor")
    places = [one for one in numbers(read) if one[0] not in claimed]
    assert len(places) > 300
    wrong = copy.deepcopy(read)
    for place in places:
        *above, last = place
        inner = at(wrong, above)
        inner[last] += 1
    fresh = content(audited_of(files, read))
    from socialiq.audit.report.recompute import differences

    found = set(differences(wrong, json.loads(json.dumps(fresh)), frozenset(), 1e-9))
    assert not {text(one) for one in places} - found


def numbers(value, place=()):
    """Places of all numbers."""
    below = value.items() if isinstance(value, dict) else enumerate(value)
    for name, one in below:
        if isinstance(one, dict | list):
            yield from numbers(one, (*place, name))
        elif isinstance(one, int | float) and not isinstance(one, bool):
            yield (*place, name)


def at(value, place):
    for step in place:
        value = value[step]
    return value


def text(place):
    return "report" + "".join(f"[{one}]" if isinstance(one, int) else f".{one}" for one in place)


def test_deciding_places_come_first(files, read):
    read["cloud"][0][0] += 1.0
    read["tests"]["regret"]["low"] += 1.0
    assert recomputed_differences(files, read) == ["report.tests.regret.low", "report.cloud[0][0]"]


def test_the_policy_is_that_of_the_commitment(files, read):
    read["policy"]["record"]["sha256"] = "cd" * 32
    with pytest.raises(UserError, match=r"the seeds in episodes.csv are not those"):
        recomputed_differences(files, read)


def test_only_the_policy_itself_is_left_out(files, read):
    """A reference that is better than the policy can't be set aside."""
    read["left_out"] = [read["references"].pop()]
    assert "report.left_out" in recomputed_differences(files, read)


def test_other_traffic_is_recomputed(files, read):
    read["shift"]["traffic"][0]["changes"][0]["change"] += 1.0
    assert recomputed_differences(files, read) == ["report.shift.traffic[0].changes[0].change"]
    read["shift"]["traffic"] *= 2
    with pytest.raises(UserError, match="the other traffic"):
        recomputed_differences(files, read)
    read["shift"] = None
    assert recomputed_differences(files, read) == []


@pytest.mark.parametrize("number", [0, 1])
def test_every_table_is_needed(files, read, number):
    path = evidence_path(number)
    with pytest.raises(UserError, match=f"{path} is missing"):
        recomputed_differences({name: files[name] for name in files if name != path}, read)
    with pytest.raises(UserError, match=f"{path}: it is not a table"):
        recomputed_differences({**files, path: b""}, read)


def test_the_world_is_the_declared_one(files, read):
    read["scenario"] = read["scenario"].replace("0.3", "0.0")
    with pytest.raises(UserError, match=r"the scenario in report\.json"):
        recomputed_differences(files, read)


def test_all_episodes_are_there(files, read):
    read["seeds"]["episodes"] -= 1
    with pytest.raises(UserError, match=r"episodes.csv has 60 episodes, not 59"):
        recomputed_differences(files, read)


def test_places_are_named_and_claims_of_the_auditor_may_differ(plain):
    other = copy.deepcopy(plain)
    other["timing"]["seconds"] = 99.0
    other["versions"] = {}
    other["episodes"]["worst"][1]["film"] = "episodes/worst-2.gif"
    assert differences(plain, other) == []
    other["tests"]["regret"]["low"] += 1e-12
    other["references"][0]["name"] = "x"
    other["cloud"].pop()
    del other["limits"]
    assert differences(plain, other) == [
        "report.tests.regret.low",
        "report.cloud",
        "report.limits",
        "report.references[0].name",
    ]


@pytest.mark.parametrize(
    ("old", "new", "same"),
    [
        (1.0, 1.0 + 1e-10, True),
        (1e6, 1e6 + 1e-4, True),
        (1.0, 1.0 + 1e-8, False),
        (1e-12, -1e-12, True),
        (2, 2.0, True),
        (2, 3, False),
        (10**10, 10**10 + 1, False),
        (1.0, True, False),
        (0.0, None, False),
        ("1.0", 1.0, False),
        ("pass", "fail", False),
        ([1.0], [1.0, 1.0], False),
    ],
)
def test_numbers_agree_within_a_tolerance_counts_and_texts_exactly(old, new, same):
    found = differences({"x": old}, {"x": new}, frozenset(), 1e-9)
    assert (found == []) == same, found


def test_without_a_tolerance_the_last_digit_counts():
    assert differences([0.1 + 0.2], [0.3], frozenset()) == ["report[0]"]


def test_rows_are_ignored_by_their_list():
    old, new = {"rows": [{"a": 1}, {"a": 2}]}, {"rows": [{"a": 3}, {"a": 4}]}
    assert differences(old, new, frozenset({"report.rows[].a"})) == []
    assert len(differences(old, new, frozenset())) == 2


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
