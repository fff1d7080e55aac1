"""A report's folder: whole or absent, sealed, and every change to it is found."""

import hashlib
import json
import os
import shutil
from pathlib import Path

import pytest

from socialiq.audit.log import RESULT, locked
from socialiq.audit.look import Plan, open_look, record
from socialiq.audit.report import verify
from socialiq.audit.report.content import seeds_of
from socialiq.audit.report.folder import (
    MANIFEST,
    STATEMENT,
    check_target,
    files_of,
    sealed,
    views_of,
    write_folder,
)
from socialiq.audit.report.verify import check_folder, faults, faults_by_log
from socialiq.audit.seeds import Commitment
from socialiq.cli.main import main
from socialiq.errors import UserError
from socialiq.to_json import to_json


@pytest.fixture(scope="module")
def files(report, audited):
    return files_of(report, audited.profile, audited.evidence)


@pytest.fixture
def folder(files, tmp_path):
    write_folder(tmp_path / "audit", files, replace=False)
    return tmp_path / "audit"


def test_what_was_written_verifies(folder, files):
    assert faults(folder) == []
    assert {path.name for path in folder.iterdir()} == set(files)
    for line in (folder / MANIFEST).read_text().splitlines():
        sha256, name = line.split("  ")
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == sha256


def test_a_changed_byte_anywhere_is_found(folder, files):
    for name, content in files.items():
        for place in (0, len(content) // 2, len(content) - 1):
            changed = bytearray(content)
            changed[place] ^= 1
            (folder / name).write_bytes(changed)
            assert faults(folder), (name, place)
        (folder / name).write_bytes(content + b"\n")
        assert faults(folder), name
        (folder / name).write_bytes(content)
    assert faults(folder) == []


def test_missing_and_added_files_are_found(folder):
    (folder / "report.md").rename(folder / "other.md")
    assert faults(folder) == ["report.md is missing", "other.md was added"]
    (folder / "other.md").rename(folder / "report.md")
    (folder / "more").mkdir()
    (folder / "more" / "x").write_text("x")
    assert faults(folder) == ["more/x was added"]


def test_links_out_of_the_folder_are_refused(folder, tmp_path):
    (tmp_path / "secret").write_text("x")
    (folder / "episodes").symlink_to(tmp_path / "secret")
    with pytest.raises(UserError, match="is a link"):
        faults(folder)


def test_a_pipe_is_not_waited_for(folder):
    os.mkfifo(folder / "more.csv")
    with pytest.raises(UserError, match="is not a plain file"):
        faults(folder)


def test_files_that_are_large_together_are_not_read(folder, monkeypatch):
    """They may be holes that take no place on a disk, but memory once they are read."""
    for name in ("one", "two", "three"):
        with (folder / name).open("wb") as file:
            file.truncate(verify.LARGEST_FOLDER // 3)
    read = []
    monkeypatch.setattr(Path, "read_bytes", lambda path: read.append(path.name) or b"")
    with pytest.raises(UserError, match="more than an audit writes: two"):
        faults(folder)
    assert "two" not in read


def resealed(folder, files, **changed):
    """Forge a report: change files, and hash again."""
    inner = {name: one for name, one in files.items() if name not in (MANIFEST, STATEMENT)}
    inner |= {name.replace("_", "."): one for name, one in changed.items()}
    report = json.loads(inner["report.json"])
    shutil.rmtree(folder)
    write_folder(folder, sealed(inner, report), replace=False)
    return faults(folder)


def test_a_page_that_says_other_than_the_report_is_found_though_hashed_anew(folder, files):
    better = files["report.html"].replace(b"Not decided", b"Behaves as declared")
    assert better != files["report.html"]
    found = resealed(folder, files, report_html=better)
    assert found == ["report.html is not the page of report.json"]


def report_of(files):
    return json.loads(files["report.json"])


def as_bytes(report):
    return (json.dumps(report, indent=2) + "\n").encode()


def of_another_version(files):
    return report_of(files) | {"hashes": report_of(files)["hashes"] | {"package": 64 * "0"}}


def pages(report):
    return {name.replace(".", "_"): page for name, page in views_of(report).items()}


@pytest.mark.slow
def test_a_page_of_a_version_that_does_not_exist_is_not_checked(folder, files, capsys):
    better = files["report.html"].replace(b"Not decided", b"Behaves as declared")
    text = as_bytes(of_another_version(files))
    assert resealed(folder, files, report_json=text, report_html=better) == []
    assert "report.html" in check_folder(folder).not_checked
    assert main(["audit", "verify", str(folder)]) == 3
    assert "is not checked as a whole" in capsys.readouterr().out
    assert main(["audit", "verify", str(folder), "--json"]) == 3
    assert "report.html" in json.loads(capsys.readouterr().out)["not_checked"]


@pytest.mark.slow
def test_pages_of_another_version_that_say_the_same_are_checked(folder, files):
    report = of_another_version(files)
    assert resealed(folder, files, report_json=as_bytes(report), **pages(report)) == []
    found = check_folder(folder)
    assert found.not_checked == [] and "pages" in found.checked
    assert main(["audit", "verify", str(folder)]) == 0


@pytest.mark.slow
def test_numbers_of_another_version_are_not_checked_but_its_decision_is(folder, files):
    """An older version may have had wider bounds; no version decides otherwise unnoticed."""
    report = of_another_version(files)
    report["tests"]["regret"]["high"] += 1.0
    assert resealed(folder, files, report_json=as_bytes(report), **pages(report)) == []
    assert check_folder(folder).not_checked == ["report.tests.regret.high"]
    report["verdict"]["decision"] = "pass"
    found = resealed(folder, files, report_json=as_bytes(report), **pages(report))
    assert "report.verdict.decision does not follow from the episodes" in found
    assert "report.tests.regret.high does not follow from the episodes" in found


@pytest.mark.slow
def test_a_file_that_no_audit_writes_is_not_checked(folder, files, capsys):
    assert resealed(folder, files, approval_pdf=b"approved") == []
    assert check_folder(folder).not_checked == ["approval.pdf"]
    assert main(["audit", "verify", str(folder)]) == 3
    assert "approval.pdf" in capsys.readouterr().out.splitlines()[0]


def test_another_declaration_is_found_though_hashed_anew(folder, files):
    other = files["profile.toml"].replace(b"An owner", b"No owner")
    assert resealed(folder, files, profile_toml=other) == [
        "profile.toml is not the declaration of report.json"
    ]


def test_another_commitment_is_found_though_hashed_anew(folder, files):
    report = report_of(files)
    report["hashes"]["policy"] = "00" * 32
    found = resealed(folder, files, report_json=as_bytes(report))
    assert "the commitment in report.json is not that of its hashes" in found


def test_the_statement_is_in_totos(folder, files, report):
    content = json.loads((folder / STATEMENT).read_bytes())
    assert content["_type"] == "https://in-toto.io/Statement/v1"
    subjects = {one["name"]: one["digest"]["sha256"] for one in content["subject"]}
    assert set(subjects) == set(files) - {MANIFEST, STATEMENT}
    for name, sha256 in subjects.items():
        assert hashlib.sha256(files[name]).hexdigest() == sha256
    assert content["predicate"]["verdict"]["decision"] == report["verdict"]["decision"]


def test_a_folder_is_replaced_only_if_asked_and_only_if_it_is_a_report(folder, files, tmp_path):
    with pytest.raises(UserError, match="add --replace"):
        write_folder(folder, files, replace=False)
    write_folder(folder, files, replace=True)
    (folder / "diary.txt").write_text("mine")
    with pytest.raises(UserError, match=r"holds diary\.txt, which no audit wrote"):
        write_folder(folder, files, replace=True)
    assert (folder / "diary.txt").read_text() == "mine"
    assert [path.name for path in tmp_path.iterdir()] == ["audit"]
    (tmp_path / "file").write_text("x")
    with pytest.raises(UserError, match="is not a folder"):
        check_target(tmp_path / "file", replace=True)


def test_nothing_is_left_where_writing_fails(files, tmp_path, monkeypatch):
    import socialiq.audit.report.folder as module

    def full(path, content):
        raise UserError("no space")

    monkeypatch.setattr(module, "write_atomically", full)
    with pytest.raises(UserError, match="no space"):
        write_folder(tmp_path / "audit", files, replace=False)
    assert list(tmp_path.iterdir()) == []


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
                "references": [],
                "left_out": [{"record": None}],
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
def place(tmp_path, declared):
    return Place(tmp_path, declared("crossing7", 0.0))


def faults_with(place, **changes):
    for section, values in changes.items():
        place.report[section] = values and {**place.report[section], **values}
    content = json.dumps(place.report).encode()
    return " ".join(faults_by_log(content, place.report, place.path))


def test_a_look_is_found_in_its_log(place):
    assert faults_with(place) == ""


def test_a_log_may_have_grown_since(place, declared):
    profile = declared("crossing7", 0.0)
    open_look(place.folder, Plan(Commitment("00" * 32, "11" * 32), profile, 60, False, ()))
    assert faults_with(place) == ""


def test_a_reference_that_was_not_committed_to_is_found(place):
    place.report["references"] = [{"record": {"sha256": "cd" * 32}}]
    assert "its list of references is not that of" in faults_with(place)


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
    assert fault in faults_with(place, **changes)


def test_a_report_of_another_owner_is_refused(place):
    with pytest.raises(UserError, match="line 1 was changed"):
        faults_with(place, declaration={"owner": "Another"})


def test_a_second_result_for_a_look_does_not_count(place, declared):
    """The first line of a kind is the one that counts; a later one can't replace it."""
    subject = Plan(Commitment("", ""), declared("crossing7", 0.0), 60, False, ()).subject
    place.report["timing"] = "another report"
    (place.folder / "report.json").write_text(json.dumps(place.report))
    with locked(place.folder, subject) as log:
        fields = {"commitment": place.report["look"]["entry"], "decision": "pass"}
        log.append(RESULT, {**fields, "report_sha256": place.sha256})
    assert "has another result for look 2" in faults_with(place)
