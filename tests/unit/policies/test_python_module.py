"""A Python policy's files, found without running its author's code."""

import sys

import pytest

from socialiq.errors import UserError
from socialiq.policies.load import command_of_python, hash_of_python

RUNS = "import pathlib; pathlib.Path(__file__).with_suffix('.ran').touch()\n"


@pytest.fixture
def package(tmp_path, monkeypatch):
    folder = tmp_path / "a_package_of_theirs"
    folder.mkdir()
    for name in ("__init__.py", "driver.py"):
        (folder / name).write_text(RUNS)
    (tmp_path / "a_module_of_theirs.py").write_text(RUNS)
    monkeypatch.syspath_prepend(tmp_path)
    return folder


def covered(name, files=()):
    return hash_of_python(name, f"python:{name}", files)


def test_a_whole_package_is_covered_and_nothing_is_imported(package):
    before = covered("a_package_of_theirs.driver:policy")
    assert list(before.paths) == [package]
    (package / "weights.bin").write_bytes(b"1")
    assert covered("a_package_of_theirs.driver:policy").sha256 != before.sha256
    assert not list(package.parent.rglob("*.ran")) and "a_package_of_theirs" not in sys.modules


def test_a_module_or_a_file_is_covered_with_what_is_named(package):
    module = package.parent / "a_module_of_theirs.py"
    by_name, by_path = covered("a_module_of_theirs:policy"), covered(f"{module}:policy")
    assert list(by_name.paths) == list(by_path.paths) == [module]
    more = covered(f"{module}:policy", [str(package)])
    assert list(more.paths) == [module, package] and more.sha256 != by_path.sha256
    assert covered(f"{module}:other").sha256 != by_path.sha256


def test_the_same_file_in_another_folder_has_the_same_hash(tmp_path):
    places = [tmp_path / name / "policy.py" for name in ("one", "two")]
    for place in places:
        place.parent.mkdir()
        place.write_text("x = 1")
    first, second = (covered(f"{place}:policy") for place in places)
    assert first.sha256 == second.sha256


@pytest.mark.parametrize("name", ["no_such_module_of_theirs:f", "a-b:f", "no/such.py:f"])
def test_a_module_must_be_found(name):
    with pytest.raises(UserError, match="no such"):
        covered(name)


def test_the_form_is_module_and_attribute():
    for name in ("module", "module:", ":f", "module:a b"):
        with pytest.raises(UserError, match="is not MODULE:ATTRIBUTE"):
            command_of_python(name, "python:x")
