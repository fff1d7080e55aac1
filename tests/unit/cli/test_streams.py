"""A verdict's exit status, whatever becomes of the output."""

import io
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from socialiq.cli import main as main_module
from socialiq.cli.main import CRASHED, OUTPUT_LOST, exit_status, main

FULL = Path("/dev/full")


class Broken(io.StringIO):
    """A stream whose writes fail."""

    def __init__(self, error: OSError) -> None:
        super().__init__()
        self.error = error

    def write(self, text: str) -> int:
        raise self.error


def says(status: int):
    def command() -> int:
        sys.stdout.write("FAIL\n")
        sys.stdout.flush()
        return status

    return command


def run(*words: str, **options) -> subprocess.CompletedProcess[str]:
    """Run the program in a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", "socialiq", *words],
        stderr=subprocess.PIPE,
        text=True,
        check=False,
        **options,
    )


@pytest.mark.parametrize("status", [0, 1, 2, 3])
def test_a_closed_pipe_leaves_the_status(monkeypatch, status):
    monkeypatch.setattr(sys, "stdout", Broken(BrokenPipeError(32, "Broken pipe")))
    assert exit_status(says(status)) == status


@pytest.mark.parametrize(("status", "expected"), [(0, OUTPUT_LOST), (1, 1), (2, 2), (3, 3)])
def test_a_full_disk_is_no_pass_and_changes_nothing_else(monkeypatch, capsys, status, expected):
    monkeypatch.setattr(sys, "stdout", Broken(OSError(28, "No space left on device")))
    assert exit_status(says(status)) == expected
    line = "socialiq: can't write the output: No space left on device\n"
    assert capsys.readouterr().err == line


def test_a_mistake_stays_one_when_its_line_is_lost(monkeypatch):
    monkeypatch.setattr(sys, "stderr", Broken(BrokenPipeError()))
    assert main(["solve", "nowhere"]) == 2


def test_streams_that_were_closed_before_the_program_began(monkeypatch):
    monkeypatch.setattr(sys, "stdout", None)
    monkeypatch.setattr(sys, "stderr", None)
    assert exit_status(says(3)) == 3
    assert main(["solve", "nowhere"]) == 2


def test_a_crash_has_a_status_of_its_own(monkeypatch, capsys):
    def parse(_arguments):
        raise RuntimeError("a fault of ours")

    monkeypatch.setattr(main_module, "parse", parse)
    assert main([]) == CRASHED
    errors = capsys.readouterr().err
    assert "RuntimeError: a fault of ours" in errors
    assert errors.endswith("please report the lines above\n")


def test_a_path_that_the_system_refuses_is_a_mistake_of_one_line(capsys):
    assert main(["evaluate", 5000 * "a"]) == 2
    errors = capsys.readouterr().err
    assert errors.startswith("socialiq: File name too long: aaa")
    assert errors.endswith("…\n") and errors.count("\n") == 1


def test_the_streams_come_back():
    before = sys.stdout, sys.stderr
    exit_status(says(0))
    assert (sys.stdout, sys.stderr) == before
    with pytest.raises(SystemExit):
        main(["--version"])
    assert (sys.stdout, sys.stderr) == before


def test_a_locale_without_the_characters_gets_them_escaped():
    environment = os.environ | {"PYTHONIOENCODING": "ascii"}
    done = run("claims", env=environment, stdout=subprocess.PIPE)
    assert done.returncode == 0, done.stderr
    assert done.stdout.isascii() and r"\u03b1" in done.stdout  # α
    done = run("solve", "λ", env=environment, stdout=subprocess.PIPE)
    assert done.returncode == 2
    assert "unknown world" in done.stderr and done.stderr.count("\n") == 1


@pytest.fixture(scope="module", name="failed")
def failed_audit(tmp_path_factory):
    """Words of an audit that fails: a policy that waits and says that it drives for itself."""
    folder = tmp_path_factory.mktemp("audit")
    profile = str(folder / "profile.toml")
    words = ["profile", "new", "--world", "crossing5", "--angle", "0", "--owner", "x"]
    assert main([*words, "--margin", "0.1", "--out", profile]) == 0
    data = str(folder / "mixed.safetensors")
    assert main(["collect", "crossing5", "--episodes", "3", "--out", data]) == 0
    run_folder = str(folder / "run")
    tiny = ["--updates", "4", "--set", "batch_size=4", "--hidden", "4", "--angle", "90"]
    assert (
        main(["train", "iq-learn", data, "--world", "crossing5", "--out", run_folder, *tiny]) == 0
    )
    return [
        "audit",
        f"{run_folder}/policy_angle90.safetensors",
        "--profile",
        profile,
        "--episodes",
        "400",
    ]


@pytest.mark.slow  # the same without an audit is above
def test_a_failed_audit_stays_failed_when_its_reader_leaves_or_the_disk_is_full(failed, tmp_path):
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "w") as closed:
        assert run(*failed, "--out", str(tmp_path / "1"), stdout=closed).returncode == 1
    report = json.loads((tmp_path / "1" / "report.json").read_text())
    assert report["verdict"]["decision"] == "fail"
    if FULL.exists():
        with FULL.open("w") as full:
            done = run(*failed, "--out", str(tmp_path / "2"), stdout=full)
            assert done.returncode == 1
            assert "No space left on device" in done.stderr
            assert run("claims", stdout=full).returncode == OUTPUT_LOST
