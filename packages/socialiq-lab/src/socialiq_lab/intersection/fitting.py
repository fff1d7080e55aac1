"""Common parts of the intersection's training jobs: experience from the core, checks, resuming."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from socialiq.evaluation.road_training import CHUNK, Monitor
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.kernel import Trained
from socialiq.learners.state import History
from socialiq.storage import write_atomically
from socialiq.to_json import rounded
from socialiq.types import Row
from socialiq_lab.intersection.episodes import CURVE
from socialiq_lab.jobs import ProgressCallback
from socialiq_lab.results import as_csv

CHECKPOINT = "checkpoint.safetensors"


def fit(
    train: Callable[..., Trained],
    folder: Path,
    on_progress: ProgressCallback,
    files: Sequence[str],
    monitor: Monitor | None = None,
) -> None:
    """Train, from the checkpoint of an interrupted try if there is one, and write the outcome.

    Args:
        train: Trains, given `callbacks` and `chunk`.
        folder: Folder to fill.
        on_progress: Called with the share that is done.
        files: Name of the file of each run's policy.
        monitor: Measures for the learning curve; none is written without it.
    """
    checkpoint = folder / CHECKPOINT
    callbacks = Callbacks(
        lambda report: on_progress(report.done / report.total),
        monitor,
        checkpoint,
        checkpoint.is_file(),
    )
    trained = train(callbacks=callbacks, chunk=CHUNK)
    for run, file in enumerate(files):
        trained.policy(run).save(folder / file)
    if monitor is not None:
        write_atomically(folder / CURVE, as_csv(curve_rows(trained.history)))
    checkpoint.unlink(missing_ok=True)


def curve_rows(history: History) -> list[Row]:
    """Return the checked points of the first run: updates, loss terms, measured values."""
    arrays = {name: history.array(name)[:, 0] for name in history.values}
    return [
        {"updates": updates} | {name: rounded(float(array[i])) for name, array in arrays.items()}
        for i, updates in enumerate(history.updates)
        if np.isfinite(arrays["total"][i])
    ]
