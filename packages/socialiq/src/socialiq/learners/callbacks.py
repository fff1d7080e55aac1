"""Callbacks of a training run, which don't change its result: progress, files, Ctrl-C."""

from __future__ import annotations

import abc
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import Any, NamedTuple

import numpy as np

from socialiq.errors import UserError
from socialiq.foreign import optional

PARTS = "parts"
"""Unit of a report of a whole run, which counts what is not of one size."""


class Report(NamedTuple):
    """Progress after a chunk.

    Attributes:
        done: Units of work done, of each run.
        total: Units to do.
        rate: Units per second, or another time that the unit names, summed over runs.
        seconds_left: Estimated.
        terms: Mean of each named term over the chunk and over sound runs.
        monitored: What the monitor returned, each (runs,).
        failures: One line for each run that has stopped.
        unit: What is counted, "updates", or "jobs/min" where the rate is not per second; `PARTS`
            has no rate.
        by_run: Mean of each named term over the chunk, each (runs,); NaN where a run broke.
    """

    done: int
    total: int
    rate: float
    seconds_left: float
    terms: dict[str, float]
    monitored: dict[str, np.ndarray]
    failures: tuple[str, ...]
    unit: str = "updates"
    by_run: Mapping[str, np.ndarray] = MappingProxyType({})


@dataclass(frozen=True)
class Callbacks:
    """Callbacks of a run, which never change its result.

    Attributes:
        on_report: Called after each chunk.
        monitor: Given the `TrainState` of all runs, returns named values, each (runs,).
        checkpoint: File of the resumable state; written when stopped and about once a minute.
        resume: Whether to go on from that file.
        keep: Whether the state after the last update is written too.
        run_names: How failure messages call the runs.
    """

    on_report: Callable[[Report], None] | None = None
    monitor: Callable[[Any], dict[str, np.ndarray]] | None = None
    checkpoint: str | Path | None = None
    resume: bool = False
    keep: bool = False
    run_names: tuple[str, ...] = ()


class Stopped(UserError):
    """Ctrl-C: the run stopped between two chunks, and its state was saved if it has a file."""

    exit_status = 130


class Clock:
    """Rates and remaining time, of this process only."""

    def __init__(self, done: int, total: int, runs: int) -> None:
        self.total = total
        self.runs = runs
        self.saved = time.monotonic()
        self.marks = [(done, self.saved)]

    def report(
        self,
        done: int,
        record: dict[str, np.ndarray],
        monitored: dict[str, np.ndarray],
        failures: tuple[str, ...],
    ) -> Report:
        """Describe the chunk that has just ended.

        Args:
            done: Updates done of each run.
            record: Mean of each term over the chunk, each (runs,).
            monitored: Result of the monitor, each (runs,).
            failures: One line for each run that has stopped.

        Returns:
            The report, with rate and remaining time of this process.
        """
        # The first chunk includes compilation: the rate is counted from its end on.
        self.marks.append((done, time.monotonic()))
        first, began = self.marks[min(1, len(self.marks) - 2)]
        rate = (done - first) / max(self.marks[-1][1] - began, 1e-9)
        finite = {name: value[np.isfinite(value)] for name, value in record.items()}
        terms = {name: float(v.mean()) if len(v) else float("nan") for name, v in finite.items()}
        left = (self.total - done) / rate
        total = rate * self.runs
        progress = (done, self.total, total, left, terms, monitored, failures)
        return Report(*progress, by_run=record)

    def minute_passed(self) -> bool:
        """Whether a minute has passed since this last was true."""
        if time.monotonic() - self.saved < 60.0:
            return False
        self.saved = time.monotonic()
        return True


class StopRequest(threading.Event):
    """A request to stop that reaches work in a thread, where signals don't.

    Attributes:
        listeners: How many `stop_requests` of the thread are open.
    """

    def __init__(self) -> None:
        super().__init__()
        self.listeners = 0

    @contextmanager
    def reaches_thread(self) -> Iterator[None]:
        """Let `stop_requests` of this thread yield this request."""
        token = _REQUEST.set(self)
        try:
            yield
        finally:
            _REQUEST.reset(token)


_REQUEST: ContextVar[StopRequest | None] = ContextVar("stop request", default=None)


@contextmanager
def stop_requests() -> Iterator[threading.Event]:
    """Turn the first Ctrl-C into a request; a second one interrupts at once.

    In a thread the request is the one of `StopRequest.reaches_thread`, if there is one.
    """
    outside = _REQUEST.get()
    if outside is not None:
        outside.listeners += 1
        try:
            yield outside
        finally:
            outside.listeners -= 1
        return
    stop = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return
    before = signal.getsignal(signal.SIGINT)

    def request(_number: int, _frame: Any) -> None:
        stop.set()
        signal.signal(signal.SIGINT, before)

    signal.signal(signal.SIGINT, request)
    try:
        yield stop
    finally:
        signal.signal(signal.SIGINT, before)


class Tracker(abc.ABC):
    """Records of each run in a folder for another program; a context, and an `on_report`.

    A number has its name in metrics.csv, and its step is the number of updates. Existing records
    stay.

    Raises:
        UserError: If the extra is not installed, or the folder can't be written.
    """

    def __init__(self, folder: Path, run_names: Sequence[str]) -> None:
        try:
            self._runs = [self.begun(folder, name) for name in run_names]
        except OSError as error:
            raise UserError(
                f"cannot write {folder}: {error.strerror}; choose another place"
            ) from error

    @abc.abstractmethod
    def begun(self, folder: Path, name: str) -> Any:
        """Begin the record of a run.

        Args:
            folder: Folder of all records.
            name: Name of the run.

        Returns:
            An object that `write` and `end` take.
        """

    @abc.abstractmethod
    def write(self, run: Any, step: int, values: Mapping[str, float]) -> None:
        """Keep the numbers of a chunk.

        Args:
            run: Result of `begun`.
            step: Number of updates done.
            values: Number of each name.
        """

    @abc.abstractmethod
    def end(self, run: Any) -> None:
        """End a run."""

    def __enter__(self) -> Tracker:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for run in self._runs:
            self.end(run)

    def __call__(self, report: Report) -> None:
        """Write the values of a chunk, for each run."""
        columns = {**report.by_run, **report.monitored}
        for number, run in enumerate(self._runs):
            values = {name: float(np.asarray(column)[number]) for name, column in columns.items()}
            self.write(run, report.done, values)


class EventFiles(Tracker):
    """TensorBoard's event files: a folder for each run."""

    def begun(self, folder: Path, name: str) -> Any:
        """Return the writer of a run.

        Args:
            folder: Folder of all records.
            name: Name of the run, and of its folder.

        Returns:
            The writer.

        Raises:
            UserError: If the extra is not installed.
        """
        module = "tensorboard.summary.writer.event_file_writer"
        return optional(module, "tensorboard", "event files").EventFileWriter(str(folder / name))

    def write(self, run: Any, step: int, values: Mapping[str, float]) -> None:
        """Add an event, and write it to the file.

        Args:
            run: Result of `begun`.
            step: Number of updates done.
            values: Number of each name.
        """
        from tensorboard.compat.proto.event_pb2 import Event  # pyright: ignore
        from tensorboard.compat.proto.summary_pb2 import Summary  # pyright: ignore

        tags: list[Any] = [
            Summary.Value(tag=name, simple_value=value) for name, value in values.items()
        ]
        run.add_event(Event(wall_time=time.time(), step=step, summary=Summary(value=tags)))
        run.flush()

    def end(self, run: Any) -> None:
        """Close the file."""
        run.close()


class WandbRuns(Tracker):
    """Runs of Weights & Biases, offline unless its variable `WANDB_MODE` says otherwise."""

    def begun(self, folder: Path, name: str) -> Any:
        """Begin a run of the project socialiq.

        Args:
            folder: Folder of all records, which is made; files are below its `wandb`.
            name: Name of the run.

        Returns:
            The run.

        Raises:
            UserError: If the extra is not installed.
        """
        wandb = optional("wandb", "wandb", "runs of Weights & Biases")
        folder.mkdir(parents=True, exist_ok=True)
        quiet = wandb.Settings(silent=True, console="off", x_disable_stats=True)
        mode = os.environ.get("WANDB_MODE", "offline")
        where = {"project": "socialiq", "name": name, "dir": str(folder), "mode": mode}
        return wandb.init(**where, reinit="create_new", settings=quiet)

    def write(self, run: Any, step: int, values: Mapping[str, float]) -> None:
        """Add a row of the run's history.

        Args:
            run: Result of `begun`.
            step: Number of updates done.
            values: Number of each name.
        """
        run.log(dict(values), step=step)

    def end(self, run: Any) -> None:
        """Write the remaining values, and finish the run."""
        run.finish()


class MlflowRuns(Tracker):
    """Runs of MLflow in the experiment socialiq of a data base, `mlflow.db` in the folder."""

    def begun(self, folder: Path, name: str) -> Any:
        """Begin a run of the experiment socialiq, which is made if it is missing.

        Args:
            folder: Folder of the data base, which is made.
            name: Name of the run.

        Returns:
            The client, and the identity of the run.

        Raises:
            UserError: If the extra is not installed.
        """
        tracking = optional("mlflow.tracking", "mlflow", "runs of MLflow")
        folder.mkdir(parents=True, exist_ok=True)
        client = tracking.MlflowClient(f"sqlite:///{folder.resolve() / 'mlflow.db'}")
        known = client.get_experiment_by_name("socialiq")
        experiment = known.experiment_id if known else client.create_experiment("socialiq")
        return client, client.create_run(experiment, run_name=name).info.run_id

    def write(self, run: Any, step: int, values: Mapping[str, float]) -> None:
        """Add the values of a step.

        Args:
            run: Result of `begun`.
            step: Number of updates done.
            values: Number of each name.
        """
        from mlflow.entities import Metric  # pyright: ignore

        client, identity = run
        now = int(1000 * time.time())
        client.log_batch(identity, [Metric(name, x, now, step) for name, x in values.items()])

    def end(self, run: Any) -> None:
        """Mark the run as finished."""
        client, identity = run
        client.set_terminated(identity)


TRACKERS = {"tensorboard": EventFiles, "wandb": WandbRuns, "mlflow": MlflowRuns}
"""Trackers by the option of `socialiq train`, which is the name of the extra too."""
