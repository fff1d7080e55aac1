"""Files that no reader may wait for, follow without end, or take into the memory."""

import hashlib
import os
from pathlib import Path

import pytest

from socialiq.errors import UserError
from socialiq.reading import open_file, read_bytes, read_text, sha256_of_file


def refusal(read, *arguments) -> str:
    with pytest.raises(UserError) as caught:
        read(*arguments)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_file_is_read(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(b"caf\xc3\xa9")
    assert read_bytes(path, 5) == b"caf\xc3\xa9"
    assert read_text(path, 5) == "café"
    assert sha256_of_file(path) == hashlib.sha256(b"caf\xc3\xa9").hexdigest()
    with open_file(path) as file:
        assert file.read(3) == b"caf"


def test_what_is_no_file_is_refused_without_a_wait(tmp_path):
    pipe, link, loop = tmp_path / "pipe", tmp_path / "link", tmp_path / "loop"
    os.mkfifo(pipe)
    link.symlink_to("/dev/zero")
    loop.symlink_to(loop)
    for read in (lambda path: read_bytes(path, 10), sha256_of_file):
        assert "not a regular file" in refusal(read, pipe)
        assert "not a regular file" in refusal(read, link)
        assert "not a regular file" in refusal(read, Path("/dev/null"))
        assert "is a folder: name a file" in refusal(read, tmp_path)
        assert "no such file" in refusal(read, tmp_path / "missing")
        assert "no such file" in refusal(read, pipe / "below")
        assert "no such file" in refusal(read, loop)
        assert "File name too long" in refusal(read, tmp_path / ("a" * 5000))


def test_a_large_file_is_refused_and_text_must_be_text(tmp_path):
    path = tmp_path / "a"
    with path.open("wb") as file:
        file.truncate(1 << 40)  # no disk is used
    assert "larger than 100 bytes" in refusal(read_bytes, path, 100)
    path.write_bytes(b"\xff")
    assert "not UTF-8 text" in refusal(read_text, path, 100)


def test_what_a_library_says_in_several_lines_is_one(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"content")
    with pytest.raises(UserError, match=r"file: first second$"), open_file(path):
        raise OSError("first\nsecond")
