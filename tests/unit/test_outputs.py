"""Places of outputs: two processes with one of them never both succeed with one result lost."""

import contextlib
import errno
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from tests.patience import LONGER, wait_until

from socialiq import outputs
from socialiq.errors import UserError
from socialiq.storage import write_atomically

HOLDER = f"""
import sys, time
from pathlib import Path
from socialiq.outputs import claimed
with claimed(Path(sys.argv[1])):
    print("claimed", flush=True)
    time.sleep({LONGER})
"""


def names(folder) -> list[str]:
    return sorted(path.name for path in folder.rglob("*"))


def test_a_claim_keeps_others_out_and_leaves_nothing(tmp_path):
    out = tmp_path / "out"
    with outputs.claimed(out):
        with pytest.raises(UserError, match="another process is writing"), outputs.claimed(out):
            pass
        with outputs.claimed(tmp_path / "other"):
            pass
    assert names(tmp_path) == []
    with outputs.claimed(out), outputs.claimed(tmp_path / "below" / "out"):
        pass
    assert names(tmp_path) == []


@pytest.mark.skipif(os.name == "nt", reason="needs Linux or macOS")
def test_a_killed_process_leaves_no_claim_that_blocks(tmp_path):
    out = tmp_path / "out"
    holder = subprocess.Popen([sys.executable, "-c", HOLDER, str(out)], stdout=subprocess.PIPE)
    assert holder.stdout
    with holder.stdout as said:
        assert said.readline() == b"claimed\n"
    with pytest.raises(UserError, match="another process"), outputs.claimed(out):
        pass
    holder.send_signal(signal.SIGKILL)
    holder.wait()

    def can_be_claimed():
        with contextlib.suppress(UserError), outputs.claimed(out):
            return True

    wait_until(can_be_claimed)
    assert names(tmp_path) == []


@pytest.mark.parametrize("place", ["/", "..", "", "."])
def test_a_place_without_a_name_is_refused(place):
    with pytest.raises(UserError, match="no new place"), outputs.claimed(Path(place)):
        pass


@pytest.mark.parametrize("links", [True, False])
def test_a_file_that_appeared_meanwhile_stays(tmp_path, monkeypatch, links):
    def no_links(*_):
        raise OSError(errno.EPERM, "Operation not permitted")

    if not links:
        monkeypatch.setattr(os, "link", no_links)
    path = tmp_path / "file"
    write_atomically(path, "first", replace=False)
    with pytest.raises(UserError, match="exists already"):
        write_atomically(path, "second", replace=False)
    assert path.read_text() == "first" and names(tmp_path) == ["file"]
    write_atomically(path, "third")
    assert path.read_text() == "third" and names(tmp_path) == ["file"]


def test_a_folder_that_appeared_meanwhile_stays(tmp_path):
    folder = tmp_path / "made"
    with (
        pytest.raises(UserError, match="exists already"),
        outputs.whole_folder(folder) as second,
    ):
        (second / "second").write_text("2")
        with outputs.whole_folder(folder) as first:
            (first / "first").write_text("1")
    assert names(tmp_path) == ["first", "made"]


def test_an_empty_folder_is_filled(tmp_path):
    folder = tmp_path / "made"
    folder.mkdir()
    with outputs.whole_folder(folder) as part:
        (part / "new").write_text("1")
    assert names(tmp_path) == ["made", "new"]


def test_no_pipe_and_no_link_to_nothing_is_replaced(tmp_path):
    pipe, link = tmp_path / "pipe", tmp_path / "link"
    os.mkfifo(pipe)
    link.symlink_to(tmp_path / "nowhere")
    for path in (pipe, link):
        with pytest.raises(UserError, match="not a regular file"):
            write_atomically(path, "x")
        with pytest.raises(UserError, match="exists already"):
            outputs.refuse_existing(path)
    assert names(tmp_path) == ["link", "pipe"]


def test_the_folder_of_the_call_is_no_output(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for place in (tmp_path, tmp_path.parent):
        with pytest.raises(UserError, match=r"folder that you are in|exists already"):
            outputs.check_output_folder(place, replace=True)
