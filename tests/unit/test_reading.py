"""Files that no reader may wait for, follow without end, or take into the memory."""

import hashlib
import os
import re
from pathlib import Path

import pytest

from socialiq.cli.main import parse
from socialiq.errors import UserError
from socialiq.reading import (
    FOREIGN_FILES,
    foreign_file,
    open_file,
    read_bytes,
    read_text,
    sha256_of_file,
)


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


XML = b'<?xml version="1.0"?>\n<!-- <net> -->\n<%s version="1">'


@pytest.mark.parametrize(
    ("name", "content", "format_name"),
    [
        ("a.xml", XML % b"commonRoad", "a CommonRoad scenario"),
        ("a", b"\xef\xbb\xbf" + XML % b"commonRoad", "a CommonRoad scenario"),
        ("a.xml", XML % b"OpenDRIVE", "an OpenDRIVE map"),
        ("a.net.xml", XML % b"net", "a network of SUMO"),
        ("a.xml", XML % b"network", "another XML file"),
        ("a.xml", XML % b"fcd-export", "FCD output of SUMO"),
        ("a.osm", XML % b"osm", "an OSM map"),
        ("a.xml", b"<!--" * 1000, "another XML file"),
        ("a.dat", b"SQLite format 3\0", "an SQLite database"),
        ("a", b"\x80\x04\x95", "a pickle, which is never loaded"),
        ("a.npz", b"PK\x03\x04", "a zip archive"),
        ("a.TFRECORD", b"x", "a TFRecord file"),
        ("a.pb", b"x", "a Protocol Buffers file"),
        ("a.csv", b"id,x\n", "a table of text"),
        ("a.csv", b"", "a table of text"),
        ("a.safetensors", b"\x80\x04\x95", None),
        ("a.unknown", b"x", None),
    ],
)
def test_files_of_other_programs_are_known(tmp_path, name, content, format_name):
    path = tmp_path / name
    path.write_bytes(content)
    foreign = foreign_file(path)
    assert (foreign and foreign.name) == format_name


def test_commands_of_next_steps_exist():
    steps = {step for row in FOREIGN_FILES for step in (row.recording, row.demonstrations)}
    commands = [re.search(r"socialiq (.*)", step) for step in sorted(steps)]
    assert sum(command is not None for command in commands) >= 7
    for command in filter(None, commands):
        parse(command.group(1).split())
