"""`socialiq sweep`: results that resume, that equal `train`'s, and a Slurm script."""

import csv
import json
import os
import subprocess
import sys

import pytest

from socialiq.cli.main import main
from socialiq_lab.cli.sweep import array_script, ranges
from socialiq_lab.jobs import do, fingerprints
from socialiq_lab.sweep.plan import read_plan
from socialiq_lab.sweep.runs import results_of

SWEEP = """
worlds = "crossing5"
data = "mixed.safetensors"
seeds = [0, 1]
runs_per_job = 2

[static]
updates = 20
hidden = [8]

[hyperparameters]
angle = [0, 45]
"""


@pytest.fixture(name="sweep", scope="module")
def sweep_file(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sweep")
    data = folder / "mixed.safetensors"
    assert main(["collect", "crossing5", "--episodes", "3", "--out", str(data)]) == 0
    (folder / "sweep.toml").write_text(SWEEP)
    return folder / "sweep.toml"


@pytest.fixture(name="done", scope="module")
def finished_sweep(sweep):
    """Done task by task in this process; the last command finds every job finished."""
    words = ["sweep", str(sweep), "--out", str(sweep.with_name("out"))]
    for number in "01":
        assert main([*words, "--task", number]) == 0
    assert main(words) == 0
    return sweep.with_name("out")


def test_the_table_has_every_run_with_its_exact_metrics(done):
    rows = list(csv.DictReader((done / "runs.csv").read_text().splitlines()))
    assert [(row["target_angle"], row["seed"], row["readout"]) for row in rows] == [
        (angle, seed, readout)
        for angle in ("0.0", "45.0")
        for seed in "01"
        for readout in ("greedy", "soft")
    ]
    assert all(float(row["regret"]) >= 0 and row["failure"] == "" for row in rows)
    assert json.loads((done / "summary.json").read_text()) == {"jobs": 2, "runs": 4, "failures": 0}
    assert json.loads((done / "config.json").read_text())["config"]["file"]["seeds"] == [0, 1]


def test_a_policy_is_the_one_that_train_makes(done, sweep, tmp_path):
    """The runs of a job share one program, as those of `train` do."""
    words = ["train", "iq-learn", str(sweep.with_name("mixed.safetensors")), "--world", "crossing5"]
    words += ["--angle", "45", "--seed", "0", "1", "--updates", "20", "--hidden", "8"]
    assert main([*words, "--out", str(tmp_path / "run")]) == 0
    for ours, theirs in (("00002", "policy_angle45_seed0"), ("00003", "policy_angle45_seed1")):
        made = (done / "policies" / f"{ours}.safetensors").read_bytes()
        assert made == (tmp_path / "run" / f"{theirs}.safetensors").read_bytes()


@pytest.mark.parametrize("learner", ["cql", "mine.py:Clone"])
def test_another_learner_is_trained_as_train_does_and_evaluated_exactly(sweep, tmp_path, learner):
    """A learner of the package, and one of the user's own."""
    data, mine = sweep.with_name("mixed.safetensors"), tmp_path / "mine.py"
    mine.write_text(
        "from socialiq.learners.behaviour_cloning import BehaviourCloning as Base\n"
        "class Clone(Base): name = 'mine'\n"
    )
    text = SWEEP.replace("mixed.safetensors", str(data))
    if learner == "cql":
        text += "conservatism = [1.0, 2.0]\n"
    (tmp_path / "one.toml").write_text(f"learner = '{learner}'\n{text}")
    plan = read_plan(tmp_path / "one.toml", allow_code=True)
    for job in plan.jobs:
        do(job, tmp_path / "work", fingerprints(plan.jobs)[job.name], lambda _: None)
    found = results_of(plan.jobs, tmp_path / "work", plan.settings)
    rows = found.tables["runs"]
    assert len(rows) == 2 * 4 * (2 if learner == "cql" else 1)
    assert all(row["regret"] >= 0 and row["failure"] == "" for row in rows)
    words = ["own", learner.replace("mine.py", str(mine))] if ":" in learner else [learner]
    words = ["train", *words, str(data), "--seed", "0", "1", "--updates", "20", "--hidden", "8"]
    words += ["--allow-code"] if ":" in learner else []
    assert main([*words, "--out", str(tmp_path / "run")]) == 0
    start = "policy_angle0_seed" if learner == "cql" else "policy_"
    for ours, theirs in (("00000", f"{start}0"), ("00001", f"{start}1")):
        made = (tmp_path / "run" / f"{theirs}.safetensors").read_bytes()
        assert found.files[f"policies/{ours}.safetensors"] == made


def test_the_slurm_script_names_the_jobs_that_are_open(sweep, tmp_path, capsys):
    out = tmp_path / "out"
    words = ["sweep", str(sweep), "--out", str(out)]
    assert main([*words, "--slurm"]) == 0
    script = tmp_path / "out.work" / "sweep.sh"
    assert capsys.readouterr().out.startswith(f"sbatch {script}\n")
    assert "#SBATCH --array=0-1\n" in script.read_text()
    assert main([*words, "--task", "0"]) == 0
    assert capsys.readouterr().out.startswith("training/00000: finished, ")
    job = tmp_path / "out.work" / "training" / "00000" / "job.json"
    before = job.stat().st_mtime_ns
    assert main([*words, "--task", "0"]) == 0
    assert capsys.readouterr().out == "training/00000: finished, 0.0 s\n"
    assert job.stat().st_mtime_ns == before
    assert main([*words, "--slurm"]) == 0
    assert "#SBATCH --array=1\n" in script.read_text()
    assert main([*words, "--task", "1"]) == 0
    assert main([*words, "--slurm"]) == 2
    assert "every job is finished" in capsys.readouterr().err


@pytest.mark.slow
def test_the_shell_runs_the_script_as_slurm_does_and_gives_the_same_files(sweep, done, tmp_path):
    words = ["sweep", str(sweep), "--out", str(tmp_path / "out")]
    assert main([*words, "--slurm"]) == 0
    for number in "01":
        subprocess.run(
            ["bash", tmp_path / "out.work" / "sweep.sh"],
            env=os.environ | {"SLURM_ARRAY_TASK_ID": number},
            check=True,
        )
    assert main(words) == 0
    for path in sorted(done.rglob("*.*")):
        assert (tmp_path / "out" / path.relative_to(done)).read_bytes() == path.read_bytes(), path


@pytest.mark.slow
def test_processes_give_the_same_files(sweep, done, tmp_path):
    assert main(["sweep", str(sweep), "--out", str(tmp_path / "out"), "--processes", "2"]) == 0
    for path in sorted(done.rglob("*.*")):
        assert (tmp_path / "out" / path.relative_to(done)).read_bytes() == path.read_bytes(), path


@pytest.mark.parametrize(
    ("more", "line"),
    [
        (["--task", "2"], "task must be from 0 to 1, got 2"),
        (["--processes", "-1"], "processes must be at least 1, got -1"),
    ],
)
def test_mistakes_of_the_call_are_one_line(sweep, tmp_path, capsys, more, line):
    assert main(["sweep", str(sweep), "--out", str(tmp_path / "out"), *more]) == 2
    assert capsys.readouterr().err == f"socialiq: {line}\n"


def test_an_array_script_by_hand(tmp_path):
    text = array_script(["/py", "a b"], [0, 1, 2, 5], tmp_path / "100%", {"X": "a b"})
    assert "#SBATCH --array=0-2,5\n" in text
    assert f"#SBATCH --output={tmp_path}/100%%/slurm-%a.log\n" in text
    assert "export X='a b'\n" in text
    assert text.endswith("exec /py 'a b' \"$SLURM_ARRAY_TASK_ID\"\n")
    assert ranges([7]) == "7"


def test_the_script_names_this_python(sweep, tmp_path):
    assert main(["sweep", str(sweep), "--out", str(tmp_path / "out"), "--slurm"]) == 0
    assert sys.executable in (tmp_path / "out.work" / "sweep.sh").read_text()
