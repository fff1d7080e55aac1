"""The files of a process policy change after the commitment, and its hash stays the same.

Four ways: a large file, bytes that move from one file to the next, a file named as
`--option=FILE`, and a file in a folder that is named.
"""

import shlex
import sys

import pytest

from socialiq.policies.load import load_policy

POLICY = """
import json, sys
for line in sys.stdin:
    message = json.loads(line)
    if "protocol" in message:
        answer = {**message, "features": 2, "actions": 3}
    else:
        answer = {"id": message["id"], "actions": [0 for _ in message["observations"]]}
    print(json.dumps(answer), flush=True)
"""


@pytest.fixture
def sha256_with(tmp_path):
    policy = tmp_path / "policy.py"
    policy.write_text(POLICY)

    def hashed(*words):
        command = [sys.executable, "-I", "-S", policy, *words]
        with load_policy(f"process:{shlex.join(map(str, command))}", 2, 3) as loaded:
            return loaded.record.sha256

    return hashed


def test_a_large_model_is_replaced(tmp_path, sha256_with):
    model = tmp_path / "model.bin"
    with model.open("wb") as file:
        file.truncate(33 * 1024 * 1024)
    before = sha256_with(model)
    with model.open("r+b") as file:
        file.seek(17 * 1024 * 1024)
        file.write(b"other weights")
    assert sha256_with(model) != before


def test_bytes_move_from_one_file_to_the_next(tmp_path, sha256_with):
    first, second = tmp_path / "first", tmp_path / "second"
    first.write_bytes(b"drive care")
    second.write_bytes(b"fully")
    before = sha256_with(first, second)
    first.write_bytes(b"drive carefully")
    second.write_bytes(b"")
    assert sha256_with(first, second) != before


@pytest.mark.parametrize("word", ["--model={}", "model={}"])
def test_a_file_named_by_an_option_is_replaced(tmp_path, sha256_with, word):
    model = tmp_path / "model.bin"
    model.write_bytes(b"careful")
    before = sha256_with(word.format(model))
    model.write_bytes(b"hasty")
    assert sha256_with(word.format(model)) != before


@pytest.mark.parametrize("word", ["{}", "--models={}"])
def test_a_file_in_a_named_folder_is_replaced(tmp_path, sha256_with, word):
    (tmp_path / "models" / "deep").mkdir(parents=True)
    model = tmp_path / "models" / "deep" / "model.bin"
    model.write_bytes(b"careful")
    named = word.format(tmp_path / "models")
    before = sha256_with(named)
    model.write_bytes(b"hasty")
    assert sha256_with(named) != before
    model.write_bytes(b"careful")
    assert sha256_with(named) == before
    model.rename(model.with_name("other.bin"))
    assert sha256_with(named) != before
