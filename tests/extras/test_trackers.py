"""Weights & Biases and MLflow read what a training reported, a hub's client the card; offline."""

import struct

import numpy as np
import pytest
from tests.patience import wait_until

from socialiq.cli.main import main
from socialiq.learners.callbacks import MlflowRuns, Report, WandbRuns


@pytest.fixture(name="report_to")
def reports():
    """Report two chunks of two runs."""

    def report_to(tracker):
        with tracker:
            for done in (10, 20):
                loss = {"loss": np.array([done / 10, done / 20])}
                angle = {"greedy_angle": np.array([float(done), 45.0])}
                tracker(Report(done, 20, 1.0, 1.0, {}, angle, (), by_run=loss))

    return report_to


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of SQLAlchemy
def test_mlflow_has_each_run_in_one_experiment(tmp_path, report_to):
    tracking = pytest.importorskip("mlflow.tracking", reason="extra `mlflow` is not installed")
    report_to(MlflowRuns(tmp_path / "new", ("a", "b")))
    report_to(MlflowRuns(tmp_path / "new", ("c",)))
    client = tracking.MlflowClient(f"sqlite:///{tmp_path / 'new' / 'mlflow.db'}")
    (experiment,) = client.search_experiments(filter_string="name = 'socialiq'")
    runs = {run.info.run_name: run for run in client.search_runs([experiment.experiment_id])}
    assert set(runs) == {"a", "b", "c"}
    assert {run.info.status for run in runs.values()} == {"FINISHED"}
    history = client.get_metric_history(runs["b"].info.run_id, "loss")
    assert sorted((point.step, point.value) for point in history) == [(10, 0.5), (20, 1.0)]
    assert runs["a"].data.metrics == {"loss": 2.0, "greedy_angle": 20.0}


def blocks(path):
    """Yield the records of a run's file, which has LevelDB's log format behind seven bytes."""
    data, at, record = path.read_bytes(), 7, b""
    while at + 7 <= len(data):
        if (left := 32768 - at % 32768) < 7:
            at += left
            continue
        length, kind = struct.unpack_from("<HB", data, at + 4)
        record, at = record + data[at + 7 : at + 7 + length], at + 7 + length
        if kind in (1, 4):  # whole, or the last part
            yield record
            record = b""


def test_wandb_keeps_each_run_offline(tmp_path, report_to, monkeypatch):
    pytest.importorskip("wandb", reason="extra `wandb` is not installed")
    wandb_internal_pb2 = pytest.importorskip("wandb.proto.wandb_internal_pb2")

    monkeypatch.delenv("WANDB_MODE", raising=False)
    report_to(WandbRuns(tmp_path / "new", ("a", "b")))
    ended = {}

    def both_ended():  # the library's service writes on
        for path in (tmp_path / "new" / "wandb").glob("offline-run-*/*.wandb"):
            records = [wandb_internal_pb2.Record.FromString(one) for one in blocks(path)]
            if records and records[-1].HasField("exit"):
                ended[path] = records
        return len(ended) == 2

    wait_until(both_ended)
    found = {}
    for records in ended.values():
        (name,) = {one.run.display_name for one in records if one.HasField("run")}
        rows = ([(x.nested_key[0], x.value_json) for x in one.history.item] for one in records)
        found[name] = [(int(row["_step"]), float(row["loss"])) for row in map(dict, rows) if row]
    assert found == {"a": [(10, 1.0), (20, 2.0)], "b": [(10, 0.5), (20, 1.0)]}


def test_the_client_of_a_hub_reads_the_card(tmp_path):
    hub = pytest.importorskip("huggingface_hub", reason="extra `hub` is not installed")
    out = tmp_path / "hub"
    assert main(["export", "prosocial", "--format", "hub", "--out", str(out)]) == 0
    card = hub.ModelCard.load(out / "README.md", ignore_metadata_errors=False)
    assert card.data.library_name == "socialiq" and "driving" in card.data.tags
