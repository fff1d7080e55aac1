"""A report against the log that someone else holds."""

import hashlib
import json

import pytest

from socialiq.audit.log import RESULT, locked
from socialiq.audit.look import Plan, open_look, record
from socialiq.audit.report import verify
from socialiq.audit.report.content import seeds_of
from socialiq.audit.report.verify import faults_by_log
from socialiq.audit.seeds import Commitment
from socialiq.errors import UserError
from socialiq.to_json import to_json


class Place:
    """A folder with a log of two looks, and the parts of a report of the second."""

    def __init__(self, folder, profile):
        self.folder, self.subject = folder, profile
        plan = Plan(Commitment("ab" * 32, profile.sha256), profile, 60, False, ())
        open_look(folder, plan)
        drawn, look = open_look(folder, plan)
        assert look is not None
        self.path = folder / look.log
        self.report = to_json(
            {
                "declaration": {
                    "owner": profile.owner,
                    "scenario": {"sha256": profile.scenario.sha256},
                },
                "policy": {"deterministic": True},
                "hashes": {"policy": "ab" * 32, "profile": profile.sha256},
                "seeds": seeds_of(drawn, 60),
                "look": look,
            }
        )
        (folder / "report.json").write_text(json.dumps(self.report))
        record(folder, plan.subject, look, "pass", self.sha256)

    @property
    def sha256(self):
        return hashlib.sha256((self.folder / "report.json").read_bytes()).hexdigest()


@pytest.fixture
def place(tmp_path, declared, monkeypatch):
    monkeypatch.setattr(verify, "read_report", lambda path: json.loads(path.read_text()))
    return Place(tmp_path, declared("crossing7", 0.0))


def faults(place, **changes):
    for section, values in changes.items():
        place.report[section] = values and {**place.report[section], **values}
    (place.folder / "report.json").write_text(json.dumps(place.report))
    return " ".join(faults_by_log(place.folder, place.path))


def test_a_look_is_found_in_its_log(place):
    assert faults(place) == ""


def test_a_log_may_have_grown_since(place, declared):
    profile = declared("crossing7", 0.0)
    open_look(place.folder, Plan(Commitment("00" * 32, "11" * 32), profile, 60, False, ()))
    assert faults(place) == ""


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"look": None}, "report.json names no audit log"),
        ({"look": {"number": 1}}, "is look 2 by"),
        ({"look": {"entry": "00" * 32}}, "has no look 2 of report.json: one of them was written"),
        ({"look": {"before": "00" * 32}}, "its line before it is not that of"),
        ({"look": {"committed": "2020-01-01T00:00:00+00:00"}}, "its time of the commitment"),
        ({"hashes": {"policy": "00" * 32}}, "its policy is not that of"),
        ({"hashes": {"profile": "00" * 32}}, "its declaration is not that of"),
        ({"seeds": {"seed": 8}}, "its seed is not that of"),
        ({"seeds": {"source": "auditor's seed"}}, "its source of the seed is not that of"),
        ({"seeds": {"episodes": 61}}, "its number of episodes is not that of"),
        ({"policy": {"deterministic": False}}, "its selection of actions is not that of"),
        ({"timing": None}, "has another result for look 2, or none"),
    ],
)
def test_a_report_that_is_another_is_found(place, changes, fault):
    assert fault in faults(place, **changes)


def test_a_report_of_another_owner_is_refused(place):
    with pytest.raises(UserError, match="line 1 was changed"):
        faults(place, declaration={"owner": "Another"})


def test_a_second_result_for_a_look_does_not_count(place, declared):
    """The first line of a kind is the one that counts; a later one can't replace it."""
    subject = Plan(Commitment("", ""), declared("crossing7", 0.0), 60, False, ()).subject
    place.report["timing"] = "another report"
    (place.folder / "report.json").write_text(json.dumps(place.report))
    with locked(place.folder, subject) as log:
        fields = {"commitment": place.report["look"]["entry"], "decision": "pass"}
        log.append(RESULT, {**fields, "report_sha256": place.sha256})
    assert "has another result for look 2" in faults(place)
