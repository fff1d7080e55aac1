"""A declared study that is killed after its first part goes on, and ends as if it never was."""

import os
import signal
import sys
from pathlib import Path

import pytest
from tests.patience import wait_until

STUDY = """
title = "Three trainings in the 5x5 world"
world = "crossing5"

[config]
seeds = [0]
updates = 400

[defaults]
rows = "policies"
preset = "poc"
data = { trajectories = 2 }
static = { updates = "$updates" }

[[train]]
stage = "plain / first"
label = { target = "0" }
runs = { angle = [0.0] }

[[train]]
stage = "plain / second"
label = { target = "45" }
runs = { angle = [45.0] }
prior = "l1"

[[train]]
stage = "clones"
label = { target = "clone" }
learner = "behaviour_cloning"

[[table]]
name = "pooled"
from = "policies"
pool = ["target", "readout"]

[[view]]
table = "pooled"
columns = ["target", "readout", "regret"]
"""

PRIOR = """
import jax.numpy as jnp


def l1(reward, target, strength):
    return jnp.mean(jnp.abs(reward - strength * target))
"""


def tables(folder):
    """Return the tables of a results folder by name."""
    return {path.name: path.read_text() for path in folder.glob("*.csv")}


def ended(process):
    """Wait for a command; return what it printed as progress."""
    _, progress = process.communicate()
    assert process.returncode == 0, progress
    return progress


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "killpg"), reason="processes of this system have no groups")
def test_a_killed_study_goes_on_and_its_tables_are_those_of_an_unbroken_run(start, tmp_path):
    (tmp_path / "STUDY.toml").write_text(STUDY)
    (tmp_path / "study.py").write_text(PRIOR)
    words = ["-m", "socialiq", "reproduce", tmp_path / "STUDY.toml", "--allow-code"]
    words += ["--processes", "1", "--out"]
    path = {"PYTHONPATH": os.pathsep.join(sys.path)}
    killed = start(*words, tmp_path / "resumed", **path)
    work = tmp_path / "resumed.work"
    first = work / "plain   first" / "0" / "job.json"
    wait_until(lambda: first.exists() or killed.poll() is not None)
    os.killpg(killed.pid, signal.SIGKILL)
    killed.wait()
    done = first.stat().st_mtime_ns
    before = len(list(work.rglob("job.json")))
    assert before < 3 and not (tmp_path / "resumed").exists()
    progress = ended(start(*words, tmp_path / "resumed", **path))
    assert first.stat().st_mtime_ns == done
    assert f"whole run: part {before + 1} of 3, about" in progress
    assert "whole run: all 3 parts" in progress
    assert "plain   first" not in progress
    ended(start(*words, tmp_path / "unbroken", **path))
    assert tables(tmp_path / "resumed") == tables(tmp_path / "unbroken")
    assert set(tables(tmp_path / "resumed")) == {"policies.csv", "pooled.csv"}
    states = [
        {path.relative_to(folder): path.read_bytes() for path in Path(folder).rglob("trained")}
        for folder in (work, tmp_path / "unbroken.work")
    ]
    assert states[0] == states[1] and len(states[0]) == 3
