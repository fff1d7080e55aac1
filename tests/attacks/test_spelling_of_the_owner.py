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


@pytest.mark.parametrize(
    "owner",
    [
        "Exаmple Cars",  # a Cyrillic a
        "Example Сars",  # a Cyrillic C
        "Exαmple Cars",  # a Greek alpha
        "Exɑmple Cars",  # a Latin alpha of phonetics
        "ExᴀmPLE CARS",  # a small capital
    ],
)
def test_letters_that_look_alike_open_no_new_log(tmp_path, owner):
    committed(tmp_path, "Example Cars")
    with pytest.raises(UserError, match="look alike"):
        committed(tmp_path, owner)
    assert len(list(tmp_path.glob("*.jsonl"))) == 1


@pytest.mark.parametrize("owner", ["Яндекс", "Škoda Auto", "Ελλάς", "トヨタ Motor", "Ørsted ß 7"])
def test_names_of_one_script_open_a_log(tmp_path, owner):
    assert [committed(tmp_path, owner) for _ in range(2)] == [1, 2]


def test_a_log_of_such_a_name_that_exists_is_continued(tmp_path, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr("socialiq.audit.log._ALIKE", set())
        committed(tmp_path, "Exаmple Cars")
    assert committed(tmp_path, "Exаmple Cars") == 2
