"""TensorBoard reads back what metrics.csv has, lane by lane."""

import csv
import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip("tensorboard", reason="extra `tensorboard` is not installed")

from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from socialiq.cli.main import main
from socialiq.learners.callbacks import EventFiles, Report


def scalars(folder):
    read = EventAccumulator(str(folder))
    read.Reload()
    return {
        tag: [(one.step, one.value) for one in read.Scalars(tag)] for tag in read.Tags()["scalars"]
    }


def report(done, loss, angle):
    by_run = {"loss": np.array(loss)}
    monitored = {"greedy_angle": np.array(angle)}
    return Report(done, 20, 1.0, 1.0, {}, monitored, (), by_run=by_run)


def test_each_lane_has_its_own_numbers(tmp_path):
    with EventFiles(tmp_path / "events", ("a", "b")) as events:
        events(report(10, [1.5, 2.5], [0.0, 45.0]))
        events(report(20, [0.5, np.nan], [1.0, 46.0]))
    assert scalars(tmp_path / "events" / "a") == {
        "loss": [(10, 1.5), (20, 0.5)],
        "greedy_angle": [(10, 0.0), (20, 1.0)],
    }
    run = scalars(tmp_path / "events" / "b")
    assert run["loss"][0] == (10, 2.5) and np.isnan(run["loss"][1][1])


def test_a_run_that_goes_on_adds_to_its_events(tmp_path):
    for done in (10, 20):
        with EventFiles(tmp_path, ("a",)) as events:
            events(report(done, [done / 10], [0.0]))
    assert scalars(tmp_path / "a")["loss"] == [(10, 1.0), (20, 2.0)]


def test_train_writes_what_metrics_csv_has(tmp_path):
    data, out, events = tmp_path / "d.safetensors", tmp_path / "run", tmp_path / "events"
    assert main(["collect", "crossing7", "--episodes", "2", "--out", str(data)]) == 0
    command = ["train", "iq-learn", str(data), "--value-term", "value_expert", "--out", str(out)]
    command += ["--angle", "0", "90", "--strength", "1", "--updates", "20"]
    command += ["--set", "batch_size=8", "--hidden", "8"]
    assert main([*command, "--tensorboard", str(events)]) == 0
    with (out / "metrics.csv").open() as file:
        rows = {float(row["angle_target"]): row for row in csv.DictReader(file)}
    assert {path.name for path in events.iterdir()} == {
        "angle_0_strength_1_seed_0",
        "angle_90_strength_1_seed_0",
    }
    for angle, row in rows.items():
        found = scalars(events / f"angle_{angle:g}_strength_1_seed_0")
        assert set(found) == set(row) - {"updates", "angle_target", "strength", "seed"}
        for name, ((step, value),) in found.items():
            assert step == 20 and value == pytest.approx(float(row[name]), abs=1e-4, rel=1e-4)


def test_train_dial_writes_what_metrics_csv_has(tmp_path):
    out, events = tmp_path / "run", tmp_path / "events"
    command = [
        "train",
        "dial",
        "--world",
        "crossing5",
        "--preset",
        "online-alone",
        "--updates",
        "5",
    ]
    assert main([*command, "--out", str(out), "--tensorboard", str(events)]) == 0
    with (out / "metrics.csv").open() as file:
        (row,) = csv.DictReader(file)
    found = scalars(events / "seed_0")
    assert set(found) == set(row) - {"updates", "seed"}
    for name, ((step, value),) in found.items():
        assert step == 5 and value == pytest.approx(float(row[name]), abs=1e-4, rel=1e-4)


def test_neither_tensorflow_nor_torch_is_imported(tmp_path):
    code = (
        "import sys; from pathlib import Path\n"
        "from socialiq.learners.callbacks import EventFiles\n"
        f"EventFiles(Path({str(tmp_path)!r}), ('a',)).__exit__(None, None, None)\n"
        "assert not {'tensorflow', 'torch'} & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_place_that_cannot_be_written_is_one_line(tmp_path, capsys):
    data = tmp_path / "d.safetensors"
    assert main(["collect", "crossing7", "--episodes", "2", "--out", str(data)]) == 0
    (tmp_path / "file").write_text("")
    command = [
        "train",
        "iq-learn",
        str(data),
        "--value-term",
        "value_expert",
        "--out",
        str(tmp_path / "run"),
    ]
    capsys.readouterr()
    assert main([*command, "--tensorboard", str(tmp_path / "file" / "x")]) == 2
    captured = capsys.readouterr()
    assert "cannot write" in captured.err and captured.err.count("\n") == 1
    assert not (tmp_path / "run").exists()
