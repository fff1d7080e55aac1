"""Attack: an owner's name is spelled otherwise, so that each try is the first look of a new log."""

import pytest

from socialiq.audit.log import COMMITMENT, Subject, locked, read
from socialiq.errors import UserError

FIELDS = {"policy_sha256": "", "profile_sha256": "", "confidence": 0.95, "episodes": 20}
FIELDS |= {"soft": False, "references": [], "seed": {}}
SPELLED = (
    *("Example Cars", "ExampleCars", "Examp.le Cars", "example\u200bcars", "Ｅxample-Cars"),
    *("Example\u3164Cars", "Example\u115f\u1160Cars", "Example Cars\uffa0"),
    *("Exampleʼ Cars", "ExampleـCars", "Exam\u00adple Cars"),
)


def committed(folder, owner):
    with locked(folder, Subject(owner, "ab" * 32)) as log:
        log.append(COMMITMENT, FIELDS)
        return log.looks


def test_every_spelling_is_counted_in_one_log(tmp_path):
    assert [committed(tmp_path, owner) for owner in SPELLED] == list(range(1, len(SPELLED) + 1))
    (path,) = tmp_path.glob("*.jsonl")
    assert len(read(path)) == len(SPELLED)


def test_a_log_of_an_older_name_is_continued(tmp_path):
    committed(tmp_path, "Example Cars")
    (path,) = tmp_path.glob("*.jsonl")
    path.rename(path.with_name(f"example-cars-{path.name.rpartition('-')[2]}"))
    assert committed(tmp_path, "ExampleCars") == 2
    (path,) = tmp_path.glob("*.jsonl")
    path.with_name(f"examp-le-cars-{path.name.rpartition('-')[2]}").write_bytes(path.read_bytes())
    with pytest.raises(UserError, match="are logs of one owner"):
        committed(tmp_path, "Example Cars")
