"""The server of `socialiq view` in a process of its own, ended by Ctrl-C."""

import contextlib
import select
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
            ready, _, _ = select.select([server.stderr], [], [], HANG)
            line = server.stderr.readline().decode() if ready else "no answer"
            assert line.startswith("http://127.0.0.1:"), line + server.stderr.read().decode()
            yield line.strip()
            server.send_signal(signal.SIGINT)
            rest = server.stderr.read().decode()
            assert rest == "Ctrl-C ends it\nstopped\n"
            assert server.wait(HANG) == 0
        finally:
            server.kill()


@pytest.fixture(scope="session", name="serving")
def serving_fixture():
    return serving
