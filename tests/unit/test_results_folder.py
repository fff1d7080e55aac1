import math

import pytest

from socialiq import results_folder as store
from socialiq.errors import UserError
from socialiq.to_json import rounded
from socialiq_lab.registry import find

Config = find("poc").Config


def results(value=1.0):
    tables = {"rows": [{"name": "a", "value": value}, {"name": "", "value": 2}]}
    return store.Results.of("poc", Config(seeds=(3,)), tables, {"value": value, "nothing": None})


def test_a_folder_round_trips(tmp_path):
    store.save(results(), tmp_path / "r", {"picture": b"png"}, replace=False)
    read = store.load(tmp_path / "r")
    assert read.tables == results().tables
    assert read.summary == results().summary
    assert read.config["seeds"] == [3]
    assert read.versions["jax"]
    assert (tmp_path / "r" / "picture.png").read_bytes() == b"png"


def test_an_empty_table_is_left_out(tmp_path):
    found = store.Results.of("poc", Config(), {"rows": [{"a": 1}], "none": []}, {})
    store.save(found, tmp_path / "r", {}, replace=False)
    assert store.load(tmp_path / "r").tables == found.tables == {"rows": [{"a": 1}]}


def test_numbers_are_plain_and_rounded():
    import numpy as np

    given = {"a": np.float64(0.12345678), "b": [np.int64(3)], "c": math.inf, "d": -0.0}
    assert rounded(given) == {"a": 0.123457, "b": [3], "c": "inf", "d": 0.0}
    assert type(rounded(given)["b"][0]) is int


def test_an_existing_folder_is_kept_unless_replaced(tmp_path):
    folder = tmp_path / "r"
    store.save(results(1.0), folder, {}, replace=False)
    with pytest.raises(UserError, match="exists already"):
        store.save(results(2.0), folder, {}, replace=False)
    assert store.load(folder).summary["value"] == 1.0
    store.save(results(2.0), folder, {}, replace=True)
    assert store.load(folder).summary["value"] == 2.0


@pytest.mark.parametrize(
    ("content", "line"),
    [
        (b"a,b\n1,2\n3\n", "line 3 has 1 cells, the first 2"),
        (b"a,b\n1,2,3\n", "line 2 has 3 cells, the first 2"),
        (b"", "is damaged"),
        (b"a,b\n\xff\xfe,2\n", "is not UTF-8 text"),
    ],
)
def test_a_damaged_table_is_named(tmp_path, content, line):
    store.save(results(), tmp_path / "out", {}, replace=False)
    (tmp_path / "out" / "t.csv").write_bytes(content)
    with pytest.raises(UserError, match=line):
        store.load(tmp_path / "out")


def test_only_a_results_folder_is_replaced(tmp_path):
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(UserError, match="is not a results folder"):
        store.save(results(), tmp_path, {}, replace=True)
    assert (tmp_path / "thesis.txt").read_text() == "mine"


def test_a_failed_write_leaves_the_old_folder(tmp_path, monkeypatch):
    folder = tmp_path / "r"
    store.save(results(1.0), folder, {}, replace=False)

    def fail(*_):
        raise OSError("disk full")

    monkeypatch.setattr(store, "as_csv", fail)
    with pytest.raises(OSError, match="disk full"):
        store.save(results(2.0), folder, {}, replace=True)
    assert store.load(folder).summary["value"] == 1.0
    assert [path.name for path in tmp_path.iterdir()] == ["r"]


def test_a_place_that_cannot_be_written_is_refused_before_any_work():
    from pathlib import Path

    with pytest.raises(UserError, match="cannot make /proc/results"):
        store.check_target(Path("/proc/results"), replace=False)
