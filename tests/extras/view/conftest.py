"""The server of `socialiq view` in a process of its own, ended by Ctrl-C."""

import contextlib
import signal
import subprocess
import sys
from collections.abc import Iterator

import pytest
from tests.patience import HANG


@contextlib.contextmanager
def serving(*words) -> Iterator[str]:
    """Serve what the words name; yield the address, and check the end."""
    command = [sys.executable, "-m", "socialiq", "view", *map(str, words), "--no-open"]
    with subprocess.Popen(command, stderr=subprocess.PIPE) as server:
        try:
            said = []
            while not (said and said[-1].startswith("http://127.0.0.1:")):
                said.append(server.stderr.readline().decode())
                assert said[-1], "".join(said)  # it has ended
            yield said[-1].strip()
            server.send_signal(signal.SIGINT)
            rest = server.stderr.read().decode().splitlines()  # a slow machine tells of compiling
            told = [line for line in rest if not line.startswith("compil")]
            assert told == ["Ctrl-C ends it", "stopped"]
            assert server.wait(HANG) == 0
        finally:
            server.kill()


@pytest.fixture(scope="session", name="serving")
def serving_fixture():
    return serving
