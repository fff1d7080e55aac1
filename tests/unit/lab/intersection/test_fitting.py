"""Checks while a run trains, and what a training job writes."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from socialiq.evaluation.road_training import CHUNK, Checks
from socialiq.learners.callbacks import Report
from socialiq.learners.state import History
from socialiq.results_folder import from_csv
from socialiq_lab.intersection.training import CHECKPOINT, CURVE, fit


def state(updates: int) -> SimpleNamespace:
    return SimpleNamespace(optimiser=SimpleNamespace(count=np.array([updates])))


@pytest.mark.parametrize(
    ("times", "chunks", "expected"),
    [(1, 4, [4]), (2, 4, [2, 4]), (3, 7, [3, 5, 7]), (9, 2, [1, 2])],
)
def test_checks_are_spread_and_the_last_is_at_the_end(times, chunks, expected):
    checks = Checks(times=times)
    assert [chunk for chunk in range(1, chunks + 1) if checks.due(chunk, chunks)] == expected


def test_a_monitor_measures_where_a_check_is_due_and_gives_nan_elsewhere():
    monitor = Checks(times=1).monitor(2 * CHUNK, lambda _, done: {"total": float(done)}, "total")
    assert np.isnan(monitor(state(CHUNK))["total"])
    np.testing.assert_array_equal(monitor(state(2 * CHUNK))["total"], [2.0 * CHUNK])


class Trained:
    """Two runs of two chunks, of which the second was checked."""

    def __init__(self) -> None:
        self.history = History()
        self.history.add(CHUNK, {"loss": np.array([0.5, 9.0]), "total": np.array([np.nan, 9.0])})
        self.history.add(2 * CHUNK, {"loss": np.array([0.25, 9.0]), "total": np.array([3.0, 9.0])})

    def policy(self, run: int) -> SimpleNamespace:
        return SimpleNamespace(save=lambda path: path.write_text(f"policy {run}"))


@pytest.mark.parametrize("checked", [True, False])
def test_a_job_writes_policies_and_the_curve_of_checks_and_removes_the_checkpoint(
    tmp_path, checked
):
    (tmp_path / CHECKPOINT).write_text("of an interrupted try")
    shares: list[float] = []

    def train(callbacks: Any, chunk: int) -> Any:
        assert callbacks.resume and callbacks.checkpoint == tmp_path / CHECKPOINT
        callbacks.on_report(Report(chunk, 4 * chunk, 1.0, 0.0, {}, {}, ()))
        return Trained()

    monitor = Checks().monitor(CHUNK, lambda _state, _done: {}) if checked else None
    fit(train, tmp_path, shares.append, ["first", "second"], monitor)
    assert shares == [0.25]
    written = {path.name for path in tmp_path.iterdir()}
    assert written == {"first", "second"} | ({CURVE} if checked else set())
    assert (tmp_path / "second").read_text() == "policy 1"
    if checked:
        assert from_csv(tmp_path / CURVE) == [{"updates": 2 * CHUNK, "loss": 0.25, "total": 3.0}]
