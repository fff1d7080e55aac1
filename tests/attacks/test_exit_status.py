"""A verdict's exit status that says something else than the verdict.

The owner lets the reader of the output leave (`socialiq audit FILE ... | true`), so that a FAIL
becomes status 0; or lets the program crash, so that a fault of the program looks like status 1.
"""

import json
import os
import subprocess
import sys

import pytest

from socialiq.cli.main import main


def run_without_reader(*words: str) -> subprocess.CompletedProcess[str]:
    """Run the program as `socialiq ... | true` does: no one reads what it writes."""
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "w") as closed:
        return subprocess.run(
            [sys.executable, "-m", "socialiq", *words],
            stdout=closed,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )


@pytest.fixture(scope="module", name="failed")
def failed_audit(place, tmp_path_factory):
    """The folder of an audit that fails, played without a reader, and how that process ended."""
    out = tmp_path_factory.mktemp("audit") / "report"
    words = [str(place / "altruist.safetensors"), "--profile", str(place / "profile.toml")]
    done = run_without_reader("audit", *words, "--episodes", "60", "--out", str(out))
    return out, done


def test_a_reader_that_leaves_makes_no_pass_of_a_fail(failed):
    out, done = failed
    assert json.loads((out / "report.json").read_text())["verdict"]["decision"] == "fail"
    assert done.returncode == 1
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("form", [[], ["--json"]])
def test_a_reader_that_leaves_makes_no_whole_report_of_a_damaged_one(failed, tmp_path, form):
    out, _ = failed
    damaged = tmp_path / "damaged"
    damaged.mkdir()
    for path in out.iterdir():
        (damaged / path.name).write_bytes(path.read_bytes())
    (damaged / "report.html").write_text("<h1>PASS</h1>")
    done = run_without_reader("audit", "verify", str(damaged), *form)
    assert done.returncode == 1
    assert "Traceback" not in done.stderr


def test_a_crash_is_no_verdict(failed, monkeypatch, capsys):
    out, _ = failed

    def broken(*_):
        raise RuntimeError("a fault of the program")

    monkeypatch.setattr("socialiq.audit.report.verify.check_folder", broken)
    assert main(["audit", "verify", str(out)]) == 70
    assert capsys.readouterr().err.endswith("please report the lines above\n")
