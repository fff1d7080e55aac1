"""The file: its chain finds every change inside it, and says so in one line."""

import datetime
import hashlib
import json
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from socialiq.audit import log as room
from socialiq.audit.log import COMMITMENT, RESULT, SEED, AuditLog, Subject, locked, read
from socialiq.errors import UserError

SUBJECT = Subject("Example Cars", "ab" * 32)
FIELDS = {
    "policy_sha256": "11" * 32,
    "profile_sha256": "22" * 32,
    "confidence": 0.95,
    "episodes": 500,
    "soft": False,
    "references": [],
    "seed": {"source": "system entropy"},
}


def look(folder: Path, seed: int = 7) -> None:
    with locked(folder, SUBJECT) as log:
        entry = log.append(COMMITMENT, FIELDS)["sha256"]
        log.append(SEED, {"commitment": entry, "seed": seed})
        log.append(RESULT, {"commitment": entry, "decision": "pass", "report_sha256": "33" * 32})


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    folder = tmp_path_factory.mktemp("log")
    for seed in (1, 2):
        look(folder, seed)
    return SUBJECT.path_in(folder)


def test_a_line_by_hand(path):
    text = f"socialiq audit log 1\nexamplecars\n{'ab' * 32}\n"
    assert SUBJECT.sha256 == hashlib.sha256(text.encode()).hexdigest()
    first, second, *_ = path.read_text().splitlines()
    entry = json.loads(first)
    sha256 = entry.pop("sha256")
    assert entry["previous"] == SUBJECT.sha256
    plain = json.dumps(entry, separators=(",", ":"))
    assert sha256 == hashlib.sha256(plain.encode()).hexdigest()
    assert json.loads(second)["previous"] == sha256
    assert datetime.datetime.fromisoformat(entry["time"]).tzinfo is not None


def test_looks_are_counted_and_lines_found(path):
    log = AuditLog(path, SUBJECT.sha256, read(path, SUBJECT.sha256))
    assert [one["number"] for one in log.entries] == [1, 2, 3, 4, 5, 6]
    assert log.looks == 2 and log.head == log.entries[5]["sha256"]
    first, second = log.entries[0]["sha256"], log.entries[3]["sha256"]
    assert [log.look_of(one) for one in (first, second, "00" * 32)] == [1, 2, 0]
    seed, result = log.following(SEED, second), log.following(RESULT, first)
    assert seed is not None and seed["seed"] == 2
    assert result is not None and result["number"] == 3
    assert log.following(SEED, "00" * 32) is None


def test_an_owner_by_another_spelling_is_the_same():
    same = ("example cars", " Example  Cars.", "EXAMPLE\u200bCARS", "Ｅxample Cars")
    assert {Subject(one, "ab" * 32).sha256 for one in same} == {SUBJECT.sha256}
    for other in (Subject("Other Cars", "ab" * 32), Subject("Example Cars", "cd" * 32)):
        assert other.sha256 != SUBJECT.sha256
    assert Subject("../..", "ab" * 32).path_in(Path()).name.startswith("owner-")
    assert Subject("A" * 500, "ab" * 32).path_in(Path()).name.startswith("a" * 40 + "-")


def edits(lines: list[bytes]):
    """Every way to change a log but to cut whole lines off its end."""
    place = st.integers(0, len(lines) - 1)
    removed = place.filter(lambda one: one < len(lines) - 1).map(
        lambda one: lines[:one] + lines[one + 1 :]
    )
    swapped = st.permutations(range(len(lines))).map(lambda order: [lines[one] for one in order])
    doubled = st.tuples(place, place).map(
        lambda pair: [*lines[: pair[0]], lines[pair[1]], *lines[pair[0] :]]
    )
    whole = b"".join(lines)
    byte = st.tuples(st.integers(0, len(whole) - 1), st.integers(0, 255)).map(
        lambda pair: [whole[: pair[0]] + bytes([pair[1]]) + whole[pair[0] + 1 :]]
    )
    cut = st.integers(1, len(whole) - 1).map(lambda one: [whole[:one]])
    inserted = st.tuples(st.integers(0, len(whole)), st.binary(min_size=1, max_size=20)).map(
        lambda pair: [whole[: pair[0]] + pair[1] + whole[pair[0] :]]
    )
    return st.one_of(removed, swapped, doubled, byte, cut, inserted)


@given(data=st.data())
def test_any_change_is_found(path, data):
    """But lines that are missing at the end: what is left is then a log of fewer looks."""
    lines = path.read_bytes().splitlines(keepends=True)
    changed = b"".join(data.draw(edits(lines)))
    shorter = [b"".join(lines[:count]) for count in range(len(lines) + 1)]
    copy = path.with_name("changed.jsonl")
    copy.write_bytes(changed)
    if changed in shorter:
        assert len(read(copy, SUBJECT.sha256)) == shorter.index(changed)
    else:
        with pytest.raises(UserError, match=r"restore\s+the file from a copy"):
            read(copy, SUBJECT.sha256)


def test_a_value_that_was_changed_with_its_hash_is_found(path, tmp_path):
    lines = path.read_bytes().splitlines(keepends=True)
    entry = json.loads(lines[1])
    del entry["sha256"]
    entry["seed"] = 99
    entry["sha256"] = hashlib.sha256(json.dumps(entry, separators=(",", ":")).encode()).hexdigest()
    lines[1] = json.dumps(entry, separators=(",", ":")).encode() + b"\n"
    copy = tmp_path / "copy.jsonl"
    copy.write_bytes(b"".join(lines))
    with pytest.raises(UserError, match="line 3 was changed, or one before it removed"):
        read(copy)


@pytest.mark.parametrize(
    "fields",
    [
        {"kind": "other"},
        {"kind": SEED, "commitment": "00", "seed": True},
        {"kind": SEED, "commitment": "00"},
        {"kind": COMMITMENT, **FIELDS, "seed": "7"},
        {"kind": SEED, "commitment": "00", "seed": 7, "time": "yesterday"},
        {"kind": SEED, "commitment": "00", "seed": 7, "time": "2026-01-31T12:00:00"},
        {"kind": SEED, "commitment": "00", "seed": 7, "number": 2},
    ],
)
def test_a_line_of_another_form_is_refused_though_hashed(tmp_path, fields):
    entry = {"number": 1, "time": "2026-01-31T12:00:00+00:00", **fields, "previous": "00" * 32}
    text = json.dumps(entry, separators=(",", ":"))
    entry["sha256"] = hashlib.sha256(text.encode()).hexdigest()
    path = tmp_path / "log.jsonl"
    path.write_text(json.dumps(entry, separators=(",", ":")) + "\n")
    with pytest.raises(UserError, match="line 1 was changed"):
        read(path)


def test_a_log_of_another_owner_is_refused(path):
    other = Subject("Other Cars", "ab" * 32)
    with pytest.raises(UserError, match="line 1 was changed, or one before it removed"):
        read(path, other.sha256)


def test_what_is_no_log_is_refused_in_one_line(tmp_path, monkeypatch):
    with pytest.raises(UserError, match="no audit log"):
        read(tmp_path / "none.jsonl")
    with pytest.raises(UserError, match="no audit log"):
        read(tmp_path)
    monkeypatch.setattr(room, "LARGEST_LOG", 3)
    (tmp_path / "large.jsonl").write_bytes(b"1234")
    with pytest.raises(UserError, match="has more than 3 bytes: it is not an audit log"):
        read(tmp_path / "large.jsonl")


def test_a_damaged_log_is_not_extended(path, tmp_path):
    copy = tmp_path / path.name
    copy.write_bytes(path.read_bytes()[:-5])
    before = copy.read_bytes()
    with pytest.raises(UserError, match="the last line is incomplete"):
        look(tmp_path)
    assert copy.read_bytes() == before


def test_a_folder_that_can_not_be_written_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match=r"cannot write the audit log .* name another --log"):
        look(tmp_path / "file")


def test_a_log_that_another_process_holds_is_waited_for(tmp_path, monkeypatch):
    monkeypatch.setattr(room, "_WAIT", 0.05)
    with (
        locked(tmp_path, SUBJECT),
        pytest.raises(UserError, match="another process is writing"),
        locked(tmp_path, SUBJECT),
    ):
        pass
    look(tmp_path)  # it was released


WRITER = """
import sys
from pathlib import Path
from socialiq.audit.log import SEED, Subject, locked
for seed in range(5):
    with locked(Path(sys.argv[1]), Subject("Example Cars", "ab" * 32)) as log:
        log.append(SEED, {"commitment": sys.argv[2], "seed": seed})
"""


def test_processes_at_once_extend_one_chain(tmp_path):
    words = [sys.executable, "-c", WRITER, str(tmp_path)]
    writers = [subprocess.Popen([*words, name]) for name in "abc"]
    assert [one.wait() for one in writers] == [0, 0, 0]
    entries = read(SUBJECT.path_in(tmp_path), SUBJECT.sha256)
    assert sorted((one["commitment"], one["seed"]) for one in entries) == [
        (name, seed) for name in "abc" for seed in range(5)
    ]


def test_a_line_that_the_disk_has_no_room_for_leaves_the_log_whole(tmp_path, monkeypatch):
    resource = pytest.importorskip("resource", reason="needs Linux or macOS")
    with locked(tmp_path, SUBJECT) as log:
        log.append(COMMITMENT, FIELDS)
        whole = log.path.read_bytes()
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (len(whole) + 10, before[1]))
        try:
            with pytest.raises(UserError, match="File too large"):
                log.append(COMMITMENT, FIELDS)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
        assert log.path.read_bytes() == whole
    with locked(tmp_path, SUBJECT) as log:
        assert log.looks == 1
