"""Places of outputs: nothing half-written, no file under a name of another format."""

import errno
import os
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from socialiq.cli.main import main
from socialiq.cli.train.shared import RunFolder, RunOptions
from socialiq.learners.kernel import Trained
from socialiq.learners.state import History
from socialiq.outputs import all_or_none, new_folder

SWEEP = 'data = ["d.safetensors"]\nworlds = ["crossing7"]\n'


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["sweep", "s.toml", "--out", ".", "--slurm"], ". is no new place: name another --out"),
        (["sweep", "s.toml", "--out", "/", "--slurm"], "/ is no new place: name another --out"),
        (["sweep", "s.toml", "--out", "x", "--work", "/"], "name another --work"),
        (["sweep", "s.toml", "--out", "x", "--work", "..", "--slurm"], "name another --work"),
        (
            ["collect", "crossing7", "--out", "x.csv"],
            "x.csv would not be a .csv file: name it .saf",
        ),
        (["collect", "crossing7", "--out", "x.NPZ"], "would not be a .NPZ file"),
        (["reproduce"], "name a study: alternatives, "),
        # The work would take hours: the place is checked first.
        (
            ["collect", "crossing7", "--episodes", "900000", "--out", "s.toml/x"],
            "cannot make s.toml",
        ),
        (["page", "--out", "page.html"], "page.html would not be a .html file: it is a folder"),
        (["evaluate", "."], ". is a folder: name a file\n"),
    ],
)
def test_a_wrong_place_is_refused_before_anything_is_written(words, said, capsys):
    Path("s.toml").write_text(SWEEP)
    assert main(words) == 2
    line = capsys.readouterr().err
    assert said in line and line.count("\n") == 1
    assert sorted(path.name for path in Path().iterdir()) == ["s.toml"]


def test_folders_above_an_output_are_made_and_stay_only_with_it(capsys):
    words = ["collect", "crossing7", "--episodes", "2"]
    assert main([*words, "--out", "a/b/c.safetensors"]) == 0
    assert Path("a/b/c.safetensors").is_file()
    Path("kept").mkdir()
    assert main([*words, "--mixture", "none", "--out", "kept/d/e.safetensors"]) == 2
    assert main(["data", "import", "commonroad", "none.xml", "--out", "f/g"]) == 2
    assert sorted(path.name for path in Path().rglob("*")) == ["a", "b", "c.safetensors", "kept"]


def test_a_folder_of_something_else_is_no_work_folder(capsys):
    from socialiq_lab.jobs import check_work

    Path("mine").mkdir()
    check_work(Path("mine"))
    Path("mine/letter.txt").write_text("dear")
    with pytest.raises(Exception, match="mine holds something else: name a new folder with --work"):
        check_work(Path("mine"))
    Path("mine/.lock").write_text("")
    check_work(Path("mine"))


@pytest.mark.parametrize("checkpoint", [True, False])
def test_a_full_disk_leaves_no_half_of_a_training(checkpoint, monkeypatch):
    out = new_folder(Path("run"))
    if checkpoint:
        (out / "checkpoint.safetensors").write_bytes(b"0")
    run, trained = RunFolder(out, "policy", RunOptions()), object.__new__(Trained)
    learner = SimpleNamespace(no_angle=lambda: "")
    vars(trained).update(learner=learner, history=History(), hyperparameters=())

    def full(self, *_):
        (out / "policy_0.safetensors").write_bytes(b"1")
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(RunFolder, "save_policies", full)
    with pytest.raises(OSError, match="No space"):
        run.finish_policies(trained, {})
    left = sorted(path.name for path in out.iterdir()) if out.exists() else []
    assert left == (["checkpoint.safetensors"] if checkpoint else [])


def test_a_full_disk_leaves_no_empty_folder_of_a_page(monkeypatch, capsys):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("socialiq.page.write.write_page", full)
    assert main(["page", "--out", "dial-page"]) == 2
    assert "make room" in capsys.readouterr().err and not Path("dial-page").exists()


def test_what_was_there_before_a_failure_stays():
    Path("kept").mkdir()
    Path("kept/letter.txt").write_text("dear")
    with pytest.raises(ValueError, match="x"), all_or_none(Path("kept")):
        Path("kept/new.txt").write_text("half")
        raise ValueError("x")
    assert [path.name for path in Path("kept").iterdir()] == ["letter.txt"]


@pytest.mark.skipif(os.name == "nt", reason="needs Linux or macOS")
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
def test_a_killed_command_leaves_no_claim_beside_its_output(how, tmp_path):
    text = (
        "import sys, time\nfrom pathlib import Path\nfrom socialiq.outputs import claimed\n"
        "with claimed(Path('out')):\n    print('claimed', flush=True)\n    time.sleep(60)\n"
    )
    child = subprocess.Popen([sys.executable, "-c", text], stdout=subprocess.PIPE)
    assert child.stdout
    with child.stdout as said:
        assert said.readline() == b"claimed\n"
    child.send_signal(how)
    child.wait()
    assert list(tmp_path.iterdir()) == []
