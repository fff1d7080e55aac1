"""Metrics of a run as TensorBoard's event files, beside the CSV that is always written.

TensorBoard's own writer makes them; neither TensorFlow nor PyTorch is needed.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from socialiq.errors import UserError
from socialiq.foreign import optional
from socialiq.learners.callbacks import Report


class EventFiles:
    """One folder of events for each run; a context, and an `Callbacks.on_report`.

    The tag of a number is its name in metrics.csv, its step the number of updates. What is not
    finite is written as it is: TensorBoard marks it.

    Args:
        folder: Folder of all runs; it is made. Events that are there stay, as TensorBoard wants
            it of a run that goes on.
        run_names: One folder name for each run.

    Raises:
        UserError: If the extra `tensorboard` is not installed, or the folder can't be written.
    """

    def __init__(self, folder: Path, run_names: Sequence[str]) -> None:
        module = "tensorboard.summary.writer.event_file_writer"
        writer = optional(module, "tensorboard", "event files").EventFileWriter
        try:
            self._writers = [writer(str(folder / name)) for name in run_names]
        except OSError as error:
            raise UserError(
                f"cannot write {folder}: {error.strerror}; choose another place"
            ) from error

    def __enter__(self) -> EventFiles:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for writer in self._writers:
            writer.close()

    def __call__(self, report: Report) -> None:
        """Write the values of a chunk, for each run."""
        from tensorboard.compat.proto.event_pb2 import Event  # pyright: ignore
        from tensorboard.compat.proto.summary_pb2 import Summary  # pyright: ignore

        hyperparameters = {**report.by_run, **report.monitored}
        for run, writer in enumerate(self._writers):
            values: list[Any] = [
                Summary.Value(tag=name, simple_value=float(np.asarray(column)[run]))
                for name, column in hyperparameters.items()
            ]
            summary = Summary(value=values)
            writer.add_event(Event(wall_time=time.time(), step=report.done, summary=summary))
            writer.flush()
