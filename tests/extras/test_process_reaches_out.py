"""A process policy of the same user reaches out of its process (needs bubblewrap).

It reads the seed where the audit printed it, opens the memory of the audit's process, asks the
network, writes beside the report, and leaves a daemon that rewrites the report later. What it has
found it says by ending with a message.
"""

import datetime
import json
import os
import shlex
import subprocess
import sys
import time
from pathlib import Path

import pytest
from tests.patience import LONGER

from socialiq.audit.profile.profile import Margin
from socialiq.audit.profile.template import declare
from socialiq.audit.report.verify import faults

POLICY = """
import glob, json, os, pathlib, socket, sys, time

OUT, MARK = pathlib.Path(REPORT), "a daemon of the owner"


def parents():
    pid = os.getppid()
    while pid > 0:
        yield pid
        pid = int(open(f"/proc/{pid}/stat").read().rsplit(")", 1)[1].split()[1])


def seed():
    for pid in parents():
        for place in glob.glob(f"/proc/{pid}/fd/*"):
            path = os.readlink(place)
            if os.path.isfile(path) and "seed " in open(path, errors="replace").read():
                return f"seed in {path}"


def memory():
    for pid in parents():
        if "socialiq" in open(f"/proc/{pid}/cmdline").read():
            return f"memory of {pid}: {open(f'/proc/{pid}/mem', 'rb')}"


def network():
    with socket.create_connection(("127.0.0.1", PORT), 1):
        return "network"


def files():
    OUT.parent.joinpath("left-by-the-policy").write_text("x")
    return "files beside the report"


def notes():
    return f"file of the auditor: {open(NOTES).read()}"


def home():
    names = set(os.listdir(HOME)) - set(sys.base_prefix.split("/"))
    return f"files of the home folder: {names}" if names else ""


def processes():
    found = [one for one in os.listdir("/proc") if one.isdigit()]
    return f"{len(found)} processes" if len(found) > 8 else ""


def environment():
    return "environment" if "SECRET_OF_THE_AUDITOR" in os.environ else ""


def daemon():
    if os.fork():
        return
    os.setsid()
    if os.fork():
        os._exit(0)
    for stream in (0, 1, 2):
        os.close(stream)
    until = time.monotonic() + LONGER
    while time.monotonic() < until:
        try:
            page = OUT / "report.html"
            if page.exists():
                page.write_text("passed")
        except OSError:
            pass
        time.sleep(0.05)


found = []
for line in sys.stdin:
    message = json.loads(line)
    if "protocol" in message:
        answer = dict(message)
        daemon()
    else:
        for attempt in (seed, memory, network, files, notes, home, processes, environment):
            try:
                found.append(attempt())
            except OSError:
                pass
        if any(found):
            sys.exit("found " + "; ".join(filter(None, found)))
        answer = {"id": message["id"], "actions": [0 for _ in message["observations"]]}
    print(json.dumps(answer), flush=True)
"""


@pytest.fixture
def listening():
    """A port of this machine at which a server listens."""
    import socket

    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server.getsockname()[1]


def test_nothing_is_within_its_reach(tmp_path, listening):
    out, policy, profile = (tmp_path / name for name in ("out", "policy.py", "profile.toml"))
    placed = (
        POLICY.replace("REPORT", repr(str(out)))
        .replace("LONGER", str(LONGER))
        .replace("PORT", str(listening))
    )
    notes = tmp_path / "notes.txt"
    notes.write_text("mine")
    placed = placed.replace("NOTES", repr(str(notes)))
    policy.write_text(placed.replace("HOME", repr(str(Path.home()))))
    day = datetime.date(2026, 1, 31)
    profile.write_bytes(declare(45.0, "An owner", "crossing7", Margin(1.0, 10.0), day).source)
    command = shlex.join([sys.executable, "-I", "-S", str(policy)])
    words = ["audit", f"process:{command}", "--profile", str(profile), "--episodes", "50"]
    said = tmp_path / "stderr"
    with said.open("w") as stderr:
        done = subprocess.run(
            [sys.executable, "-m", "socialiq", *words, "--out", str(out)],
            stderr=stderr,
            stdout=subprocess.DEVNULL,
            env={**os.environ, "SECRET_OF_THE_AUDITOR": "1"},
        )
    assert "found" not in said.read_text()
    assert done.returncode == 1
    time.sleep(1.0)
    assert faults(out) == []
    report = json.loads((out / "report.json").read_text())
    assert report["policy"]["record"]["isolation"]["kind"].startswith("bubblewrap")
    assert not any("isolated" in one["text"] for one in report["caveats"])
    assert not (tmp_path / "left-by-the-policy").exists()
