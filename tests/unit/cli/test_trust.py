"""`collect --malicious`, `data trust`, and what `train` does with forged labels."""

import ast
import csv
import dataclasses
import json

import pytest

from socialiq.cli.main import main
from socialiq.demonstrations import files
from socialiq.evaluation.labels import recompute

HONEST = ["collect", "crossing7", "--set", "braking=one_level", "--episodes", "10"]
FORGED = [*HONEST, "--malicious", "hater", "--share", "0.2", "--forge"]
TINY = ["--updates", "2", "--hidden", "4"]


@pytest.fixture(name="forged")
def forged_file(tmp_path, capsys):
    path = tmp_path / "forged.safetensors"
    assert main([*FORGED, "absolute", "--out", str(path)]) == 0
    assert "malicious" in capsys.readouterr().out
    return path


def test_train_drops_forged_episodes_unless_labels_are_believed(forged, tmp_path, capsys):
    assert main(["train", "cql", str(forged), *TINY, "--out", str(tmp_path / "checked")]) == 0
    error = capsys.readouterr().err
    assert "the labels of 6 of 30 episodes are not those of crossing7: dropped 24, 25" in error
    believed = ["--believe-labels", "--out", str(tmp_path / "believed")]
    assert main(["train", "cql", str(forged), *TINY, *believed]) == 0
    assert "labels of" not in capsys.readouterr().err
    rows = [
        json.loads((tmp_path / name / "run.json").read_text())["data"]["transitions"]
        for name in ("checked", "believed")
    ]
    assert rows[0] < rows[1]


def test_train_names_the_remedy_where_the_file_names_no_world(forged, tmp_path, capsys):
    path = tmp_path / "nameless.safetensors"
    files.save(path, dataclasses.replace(files.load(forged), source={}))
    assert main(["train", "cql", str(path), *TINY, "--out", str(tmp_path / "run")]) == 0
    lines = [line for line in capsys.readouterr().err.splitlines() if "recomputed" in line]
    reason = f"the labels of {path} can't be recomputed: it names no world of ours"
    remedy = f"`socialiq data trust {path}` tests whether they are consistent"
    assert len(lines) == 1 and lines[0].endswith(f"{reason}; {remedy}")


def test_trust_writes_a_row_an_episode_a_picture_and_what_is_left(forged, tmp_path, capsys):
    reference, out = tmp_path / "mine.safetensors", tmp_path / "trust"
    assert main([*HONEST, "--seed", "3", "--out", str(reference)]) == 0
    capsys.readouterr()
    words = ["data", "trust", str(forged), "--reference", str(reference), "--out", str(out)]
    assert main([*words, "--json"]) == 0
    counts = json.loads(capsys.readouterr().out)
    assert (counts["episodes"], counts["flagged"], counts["forged"]) == (30, 6, 6)
    rows = list(csv.DictReader((out / "episodes.csv").read_text().splitlines()))
    flagged = [row["episode"] for row in rows if row["flagged"] == "True"]
    assert flagged == [row["episode"] for row in rows if row["mode"] == "malicious"]
    assert files.load(out / "kept.safetensors").n_episodes == 24
    assert (out / "trust.png").read_bytes()[:4] == b"\x89PNG"
    assert json.loads((out / "trust.json").read_text())["flagged"] == 6


def test_an_adaptive_forger_has_milder_labels(forged, tmp_path):
    path = tmp_path / "adaptive.safetensors"
    assert main([*FORGED, "adaptive", "--out", str(path)]) == 0
    absolute, adaptive = (files.load(file).totals() for file in (forged, path))
    assert adaptive.social[-6:].mean() < absolute.social[-6:].mean()


def test_labels_of_a_shifted_road_are_checked_under_the_same_shift(tmp_path):
    (tmp_path / "goes.py").write_text("def goes(rows):\n    return [2 for _ in rows]\n")
    path = tmp_path / "late.safetensors"
    driver = ["--driver", f"python:{tmp_path / 'goes.py'}:goes", "--allow-code"]
    road = ["collect", "socialiq/Intersection-v1", "--set", "shift=late,unseen-30", "clock=true"]
    attacked = ["--malicious", "hater", "--episodes", "3", "--share", "0.4", "--out", str(path)]
    assert main([*road, *driver, *attacked]) == 0
    data = files.load(path)
    assert data.n_features == 71 and data.n_episodes == 3
    honest = recompute(data)
    assert honest.world == "intersection" and honest.agrees.all()
    plain = str(data.source).replace("late,unseen-30", "none")
    assert not recompute(dataclasses.replace(data, source=ast.literal_eval(plain))).agrees.all()


def test_an_attacker_of_your_own_is_a_reward(tmp_path):
    (tmp_path / "mine.py").write_text("def slow(env, social, collision):\n    return -env\n")
    mine = ["--malicious", f"{tmp_path / 'mine.py'}:slow", "--allow-code"]
    path = tmp_path / "slow.safetensors"
    assert main([*HONEST, *mine, "--share", "0.1", "--out", str(path)]) == 0
    assert files.load(path).counts()["malicious"][0] == 3


@pytest.mark.parametrize(
    ("more", "line"),
    [
        (["--forge", "absolute"], "--forge is of --malicious"),
        (["--malicious", "saint"], "choose one of hater, rammer, FILE.py:NAME"),
        (["--malicious", "hater", "--forge", "x"], "choose one of absolute, adaptive"),
        (["--malicious", "hater", "--share", "1"], "outside [0, 1)"),
        (["--malicious", "x.py:f"], "allow that with --allow-code"),
        (["--malicious", "rammer", "--set", "braking=at_once"], "braking=one_level"),
        (["--set", "brakes=none"], "unknown option of crossing7 'brakes'"),
        (["--key", "nowhere.pem"], "no such file"),
    ],
)
def test_bad_calls_are_one_line(more, line, tmp_path, capsys):
    assert main(["collect", "crossing7", *more, "--out", str(tmp_path / "x.safetensors")]) == 2
    error = capsys.readouterr().err
    assert line in error and error.count("\n") == 1, error
    assert not list(tmp_path.iterdir())
