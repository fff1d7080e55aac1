import errno
import importlib.resources
import json
import os
from pathlib import Path

import numpy as np
import pytest
import safetensors.numpy

from socialiq import outputs, storage
from socialiq.errors import UserError

# The name and the number have other spellings in JSON (upper-case escapes and exponents).
HEADER = {
    "name": "\u00e9\u00c9",
    "number": 1.5e300,
    "list": [1, None, True],
    "nested": {"a": "bcde"},
}
ARRAYS = {"x": np.arange(3, dtype=np.float32), "flag": np.array([True, False])}


@pytest.fixture(name="small")
def small_file(tmp_path):
    path = tmp_path / "small.safetensors"
    storage.save_arrays(path, "demo", 1, ARRAYS, HEADER)
    return path


def refusal(path: Path, kind: str = "demo", version: int = 1) -> str:
    with pytest.raises(UserError) as caught:
        storage.load_arrays(path, kind, version)
    line = str(caught.value)
    assert "\n" not in line
    return line


def is_refused(path: Path, content: bytes) -> bool:
    path.write_bytes(content)
    try:
        storage.load_arrays(path, "demo", 1)
    except UserError as error:
        return "\n" not in str(error)
    return False


@pytest.mark.parametrize("content", ["text \u00e9", b"\x00\xff"])
def test_a_write_leaves_the_content_and_nothing_else(tmp_path, content):
    path = tmp_path / "file"
    path.write_text("old and longer than the new content")
    storage.write_atomically(path, content)
    assert path.read_bytes() == (content.encode() if isinstance(content, str) else content)
    assert path.stat().st_mode & 0o777 == 0o644
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("target", ["os.fsync", "pathlib.Path.replace", "pathlib.Path.chmod"])
def test_a_failed_write_leaves_the_old_content(tmp_path, monkeypatch, target):
    path = tmp_path / "file"
    path.write_text("old")

    def fail(*args: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(target, fail)
    with pytest.raises(UserError, match="No space left on device; choose another place"):
        storage.write_atomically(path, "new")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_an_interrupted_write_leaves_the_old_content(tmp_path, monkeypatch):
    path = tmp_path / "file"
    path.write_text("old")

    def interrupt(*args: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("os.fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        storage.write_atomically(path, "new")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_write_without_its_folder_is_refused(tmp_path):
    with pytest.raises(UserError, match="No such file or directory; choose another place"):
        storage.write_atomically(tmp_path / "missing" / "file", "new")


def test_a_write_over_a_folder_is_refused(tmp_path):
    folder = tmp_path / "folder"
    folder.mkdir()
    with pytest.raises(UserError, match="Is a directory; choose another place"):
        storage.write_atomically(folder, "new")
    assert list(tmp_path.iterdir()) == [folder]


def test_json_round_trip_keeps_the_order_of_keys(tmp_path):
    path = tmp_path / "file.json"
    content = {"z": 1, "a": [1.5, None, "\u00e9"]}
    storage.write_json(path, content)
    assert storage.read_json(path) == content
    assert list(storage.read_json(path)) == ["z", "a"]
    assert path.read_text().endswith("}\n")


def test_json_has_no_nan(tmp_path):
    with pytest.raises(ValueError, match="not JSON compliant"):
        storage.write_json(tmp_path / "file.json", {"a": float("nan")})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("content", [b"", b"{", b"{'a': 1}", b"\xff\xfe\xfa", b"[" * 200_000])
def test_what_is_not_json_is_refused(tmp_path, content):
    path = tmp_path / "file.json"
    path.write_bytes(content)
    with pytest.raises(UserError, match=r"cannot read .*file\.json as JSON: .+") as caught:
        storage.read_json(path)
    assert "\n" not in str(caught.value)


def test_missing_json_is_refused(tmp_path):
    with pytest.raises(UserError, match="no such file"):
        storage.read_json(tmp_path / "file.json")
    with pytest.raises(UserError, match="is a folder"):
        storage.read_json(tmp_path)


def test_a_new_folder_is_made_with_its_parents(tmp_path):
    made = outputs.new_folder(tmp_path / "a" / "b")
    assert made.is_dir()
    assert outputs.new_folder(made) == made  # still empty


def test_a_folder_in_use_is_refused_and_left_alone(tmp_path):
    file = tmp_path / "file"
    file.write_text("kept")
    for taken in (tmp_path, file):
        with pytest.raises(UserError, match="exists already: name a new folder"):
            outputs.new_folder(taken)
    with pytest.raises(UserError, match=r"cannot make .*: Not a directory"):
        outputs.new_folder(file / "below")
    assert file.read_text() == "kept"


def test_arrays_round_trip(small):
    arrays, header = storage.load_arrays(small, "demo", 1)
    assert set(arrays) == set(ARRAYS)
    for name, array in ARRAYS.items():
        assert arrays[name].dtype == array.dtype
        np.testing.assert_array_equal(arrays[name], array)
    sha256 = storage.save_arrays(small, "demo", 1, ARRAYS, HEADER)
    assert header == {"kind": "demo", "version": 1, **HEADER, "sha256": sha256}


@pytest.mark.parametrize(
    "array",
    [
        np.array(3.0),
        np.zeros((0, 3), np.int8),
        np.arange(6.0).reshape(2, 3).T,
        np.arange(10)[::-2],
        np.arange(3, dtype=">f8"),
        np.array([np.nan, np.inf, -0.0]),
    ],
)
def test_arrays_of_every_layout_round_trip(tmp_path, array):
    path = tmp_path / "file"
    storage.save_arrays(path, "demo", 1, {"x": array}, {})
    found = storage.load_arrays(path, "demo", 1)[0]["x"]
    assert found.shape == array.shape
    np.testing.assert_array_equal(found, array)


def test_a_header_comes_back_as_json_would_give_it(tmp_path):
    path = tmp_path / "file"
    storage.save_arrays(path, "demo", 1, {}, {"counts": {2: (1, 2), 10: ()}})
    assert storage.load_arrays(path, "demo", 1)[1]["counts"] == {"2": [1, 2], "10": []}


@pytest.mark.parametrize(
    ("arrays", "header"),
    [
        ({**ARRAYS, "x": ARRAYS["x"] + 1}, HEADER),
        ({**ARRAYS, "x": ARRAYS["x"].astype(np.int32)}, HEADER),
        ({**ARRAYS, "x": ARRAYS["x"][:, None]}, HEADER),
        ({"y": ARRAYS["x"], "flag": ARRAYS["flag"]}, HEADER),
        (ARRAYS, {**HEADER, "number": 1.0}),
    ],
)
def test_the_hash_is_of_all_content(arrays, header):
    assert storage.content_hash(arrays, header) != storage.content_hash(ARRAYS, HEADER)


def test_the_hash_does_not_depend_on_the_order_of_names():
    turned = dict(reversed(ARRAYS.items())), dict(reversed(HEADER.items()))
    assert storage.content_hash(*turned) == storage.content_hash(ARRAYS, HEADER)


def test_other_kinds_and_versions_are_refused(small):
    assert "holds demo, not policy: name a policy file" in refusal(small, kind="policy")
    assert "schema version 1, this program reads version 2" in refusal(small, version=2)


def test_every_changed_byte_is_refused(small):
    whole = small.read_bytes()
    assert b"}   " in whole  # the header is padded, and the padding is tried too
    # Each bit alone, all bits, and what JSON may read as the same: blanks, zeros, exponents.
    for place, byte in enumerate(whole):
        others = {byte ^ mask for mask in (1, 2, 4, 8, 16, 32, 64, 128, 255)}
        for other in (others | set(b"\t\n\r 0+eE")) - {byte}:
            changed = whole[:place] + bytes([other]) + whole[place + 1 :]
            assert is_refused(small, changed), f"byte {place}: {byte:#x} changed to {other:#x}"


def test_every_truncated_or_prolonged_file_is_refused(small):
    whole = small.read_bytes()
    for length in range(len(whole)):
        assert is_refused(small, whole[:length]), f"cut to {length} bytes"
    for more in (b"\x00", b" ", b"\x00" * 8, whole):
        assert is_refused(small, whole + more)
    assert not is_refused(small, whole)


def test_a_missing_file_and_a_folder_are_refused(tmp_path):
    assert "no such file" in refusal(tmp_path / "missing")
    assert "is a folder: name a file" in refusal(tmp_path)


@pytest.mark.parametrize(
    "wrapper", ["null", "[]", "{}", '{"header": 3}', json.dumps({"header": {"kind": "demo"}})]
)
def test_foreign_safetensors_are_refused(tmp_path, wrapper):
    path = tmp_path / "file"
    path.write_bytes(safetensors.numpy.save(ARRAYS, metadata={"socialiq": wrapper}))
    assert "demo" in refusal(path)
    path.write_bytes(safetensors.numpy.save(ARRAYS))
    assert "not a socialiq file: expected a demo file" in refusal(path)


@pytest.mark.parametrize("wrapper", ["{", "[" * 200_000])
def test_a_header_that_is_not_json_is_refused(tmp_path, wrapper):
    path = tmp_path / "file"
    path.write_bytes(safetensors.numpy.save(ARRAYS, metadata={"socialiq": wrapper}))
    assert "damaged or not a demo file" in refusal(path)


def test_a_sound_file_of_another_program_is_not_called_damaged(tmp_path):
    path = tmp_path / "scenario.xml"
    path.write_text("<commonRoad/>")
    for kind in ("recording", "demonstrations"):
        with pytest.raises(UserError, match=r"CommonRoad.*: socialiq data import commonroad FILE"):
            storage.load_arrays(path, kind, 1)
    with pytest.raises(UserError, match="is a CommonRoad scenario: name a dial file"):
        storage.load_arrays(path, "dial", 1)


def test_results_are_found_outside_of_a_checkout(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    summary = Path("results/grid/summary.json")
    assert storage.shipped(summary) == storage.packaged_results() / "grid" / "summary.json"
    for other in (Path("results/no-such-study"), Path("grid/summary.json")):
        assert storage.shipped(other) == other
    summary.parent.mkdir(parents=True)
    summary.write_text("{}")
    assert storage.shipped(summary) == summary


def test_kind_is_told_without_a_check(tmp_path):
    path = tmp_path / "a.safetensors"
    storage.save_arrays(path, "policy", 1, {"a": np.zeros(2)}, {})
    assert storage.kind_of(path) == "policy"
    path.write_bytes(b"\xff" * 50)
    assert storage.kind_of(path) == storage.kind_of(tmp_path / "missing") == ""


@pytest.mark.parametrize("kind", ["\x1b[2J", "two\nlines", "x" * 5000, ""])
def test_a_kind_that_is_no_word_is_not_repeated(tmp_path, kind):
    storage.save_arrays(tmp_path / "a.safetensors", kind, 1, {"a": np.zeros(2)}, {})
    with pytest.raises(UserError, match="holds something else, not policy") as refusal:
        storage.load_arrays(tmp_path / "a.safetensors", "policy", 1)
    assert "\n" not in str(refusal.value)


def test_a_pipe_says_nothing_of_its_kind(tmp_path):
    os.mkfifo(tmp_path / "a.safetensors")
    assert storage.kind_of(tmp_path / "a.safetensors") == ""


def test_a_folder_is_replaced_whole_or_stays(tmp_path):
    folder = tmp_path / "made"
    with outputs.whole_folder(folder) as part:
        (part / "old").write_text("1")
    with pytest.raises(KeyError), outputs.whole_folder(folder) as part:
        (part / "new").write_text("2")
        raise KeyError
    assert [path.name for path in tmp_path.rglob("*")] == ["made", "old"]
    with pytest.raises(UserError, match="exists already"), outputs.whole_folder(folder) as part:
        (part / "new").write_text("2")
    assert [path.name for path in tmp_path.rglob("*")] == ["made", "old"]
    with outputs.whole_folder(folder, replace=True) as part:
        (part / "new").write_text("2")
    assert [path.name for path in tmp_path.rglob("*")] == ["made", "new"]


def test_an_output_folder_is_checked_before_the_work(tmp_path):
    folder = tmp_path / "parent" / "out"
    assert not outputs.check_output_folder(folder, replace=False) and folder.parent.is_dir()
    folder.mkdir()
    assert not outputs.check_output_folder(folder, replace=False)
    (folder / "file").write_text("1")
    assert outputs.check_output_folder(folder, replace=True)
    with pytest.raises(UserError, match="add --replace"):
        outputs.check_output_folder(folder, replace=False)
    with pytest.raises(UserError, match="is not a folder"):
        outputs.check_output_folder(folder / "file", replace=True)
    (tmp_path / "link").symlink_to(folder)
    with pytest.raises(UserError, match="is not a folder"):
        outputs.check_output_folder(tmp_path / "link", replace=True)


def test_a_package_in_a_short_path_has_no_checkout_around_it(monkeypatch):
    monkeypatch.setattr(importlib.resources, "files", lambda _: Path("/site/socialiq"))
    with pytest.raises(UserError, match="--results DIR"):
        storage.packaged_results()
