"""Ctrl-C on a real process, and the run that goes on from there."""

import json
import os
import signal
import subprocess
import sys

import pytest
from tests.patience import HANG

from socialiq.cli.main import main

SETTINGS = ["--world", "crossing7", "--seed", "1", "2", "--updates", "4000", "--hidden", "16"]


def start(*arguments):
    environment = os.environ | {"PYTHONUNBUFFERED": "1"}
    command = [sys.executable, "-c", "from socialiq.cli.main import main; raise SystemExit(main())"]
    return subprocess.Popen(
        [*command, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
    )


def wait_for_first_chunk(process):
    """The plain progress line of a first chunk, without a terminal."""
    assert any(line.startswith("training: ") for line in process.stderr), "no progress was shown"


@pytest.mark.slow
def test_ctrl_c_leaves_a_run_that_resumes_to_the_same_bits(tmp_path):
    data = tmp_path / "mixed.safetensors"
    main(["collect", "crossing7", "--episodes", "2", "--out", str(data)])
    stopped, whole = tmp_path / "stopped", tmp_path / "whole"

    process = start("train", "iq-learn", data, "--out", stopped, *SETTINGS)
    wait_for_first_chunk(process)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=HANG)
    assert process.returncode == 130
    assert errors.splitlines()[-1].endswith("go on with --resume")
    assert (stopped / "checkpoint.safetensors").is_file()
    assert not (stopped / "run.json").exists()

    assert main(["train", "iq-learn", str(data), "--out", str(stopped), *SETTINGS, "--resume"]) == 0
    assert main(["train", "iq-learn", str(data), "--out", str(whole), *SETTINGS]) == 0
    records = [json.loads((run / "run.json").read_text()) for run in (stopped, whole)]
    hashes = [[one["sha256"] for one in record["policies"]] for record in records]
    assert hashes[0] == hashes[1]
    assert (stopped / "metrics.csv").read_bytes() == (whole / "metrics.csv").read_bytes()


@pytest.mark.slow
def test_a_finished_run_and_another_runs_checkpoint_are_not_resumed(tmp_path, capsys):
    data = tmp_path / "mixed.safetensors"
    main(["collect", "crossing7", "--episodes", "2", "--out", str(data)])
    out = tmp_path / "run"
    short = ["--world", "crossing7", "--updates", "10", "--hidden", "8"]
    assert main(["train", "iq-learn", str(data), "--out", str(out), *short]) == 0
    capsys.readouterr()
    assert main(["train", "iq-learn", str(data), "--out", str(out), *short, "--resume"]) == 2
    assert "holds a finished run" in capsys.readouterr().err
