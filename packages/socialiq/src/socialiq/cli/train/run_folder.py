"""Folder of a training: its policies, metrics.csv and run.json, and the callbacks meanwhile."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

from socialiq.cli.output import complain, print_json, print_table
from socialiq.cli.progress import Display, to_all
from socialiq.cli.train.options import RunOptions
from socialiq.errors import UserError
from socialiq.learners.callbacks import Callbacks, EventFiles
from socialiq.learners.kernel import Trained
from socialiq.outputs import new_folder
from socialiq.reading import sha256_of_file
from socialiq.results_folder import as_csv, versions
from socialiq.storage import write_atomically, write_json
from socialiq.to_json import rounded
from socialiq.types import Row

CHUNK = 500
"""Updates between two rows of metrics.csv."""

PLURALS = {"policy": "policies", "dial": "dials"}
"""Kinds of policies, and their key in run.json."""


@dataclasses.dataclass(frozen=True)
class RunFolder:
    """Output folder of `train`.

    Attributes:
        out: The folder.
        kind: Of its policies: "policy" or "dial".
        options: Whether a stopped training goes on, and where event files go.
        as_json: Whether `report` prints one JSON object.
    """

    out: Path
    kind: str
    options: RunOptions
    as_json: bool

    @property
    def checkpoint(self) -> Path:
        """State of the unfinished training."""
        return self.out / "checkpoint.safetensors"

    @contextmanager
    def callbacks(self, runs: Sequence[Row], monitor: Any = None) -> Iterator[Callbacks]:
        """Make the folder; yield the callbacks of the training, with its progress shown.

        A folder that the training made and wrote nothing into is removed when it fails.

        Args:
            runs: By run, the settings in which it differs from the others.
            monitor: Measures the policies after each chunk.

        Raises:
            UserError: If the folder has content, or a training to resume is finished.
        """
        with ExitStack() as stack:
            listeners = []
            if self.options.tensorboard is not None:
                names = [
                    "_".join(f"{name}_{value:g}" for name, value in row.items()) for row in runs
                ]
                listeners.append(stack.enter_context(EventFiles(self.options.tensorboard, names)))
            if not self.options.resume:
                if not self.out.exists():
                    stack.push(self._remove_if_empty)
                new_folder(self.out)
            elif (self.out / "run.json").exists():
                raise UserError(f"{self.out} holds a finished run: there is nothing to resume")
            show = stack.enter_context(Display()).stage("training")
            yield Callbacks(
                on_report=to_all([show, *listeners]),
                monitor=monitor,
                checkpoint=self.checkpoint,
                resume=self.options.resume,
            )

    def _remove_if_empty(self, failed: type[BaseException] | None, *_: Any) -> None:
        """Remove the folder after a failure, unless it has content."""
        if failed is not None:
            with suppress(OSError):
                self.out.rmdir()

    def save_policies(
        self, trained: Trained, change: Callable[[Any], Any] | None = None
    ) -> list[Row]:
        """Write the policy of each run, changed if need be; return the files' names and hashes."""
        names = [f"{self.kind}_{run}.safetensors" for run in range(len(trained.hyperparameters))]
        policies = [trained.policy(run) for run in range(len(names))]
        return [
            {"file": name, "sha256": (change(policy) if change else policy).save(self.out / name)}
            for name, policy in zip(names, policies, strict=True)
        ]

    def finish_policies(
        self,
        trained: Trained,
        labels: Sequence[Row],
        record: Mapping[str, Any],
        change: Callable[[Any], Any] | None = None,
    ) -> int:
        """Write the policies and their record, and print them; return the exit status.

        Args:
            trained: The training's outcome.
            labels: By run, the settings in which it differs.
            record: Further entries of run.json.
            change: Applied to each policy before it is written.
        """
        arrays = {name: trained.history.array(name) for name in trained.history.values}
        columns = {"greedy_angle": "angle_hat", "greedy_arrival": "arrival", "loss": "loss"}
        saved = self.save_policies(trained, change)
        policies = [
            {**row, **file}
            | {columns[name]: float(arrays[name][-1, run]) for name in arrays if name in columns}
            for run, (row, file) in enumerate(zip(labels, saved, strict=True))
        ]
        renamed = [
            {"angle_target" if name == "angle" else name: value for name, value in row.items()}
            for row in labels
        ]
        self.finish(trained, renamed, policies, record)
        return self.report(trained, policies)

    def finish(
        self,
        trained: Trained,
        runs: Sequence[Row],
        policies: Sequence[Row],
        record: Mapping[str, Any],
    ) -> None:
        """Write metrics.csv and run.json, and remove the checkpoint.

        Args:
            trained: The training's outcome.
            runs: By run, the settings in which it differs, as columns of metrics.csv.
            policies: By run, its entry in run.json.
            record: Further entries of run.json.
        """
        history = trained.history
        arrays = {name: history.array(name) for name in history.values}
        rows = [
            {"updates": updates}
            | label
            | {name: rounded(float(array[chunk, run])) for name, array in arrays.items()}
            for chunk, updates in enumerate(history.updates)
            for run, label in enumerate(runs)
        ]
        write_atomically(self.out / "metrics.csv", as_csv(rows))
        settings = {
            "structure": dataclasses.asdict(trained.static),
            "numbers": [dataclasses.asdict(numbers) for numbers in trained.hyperparameters],
        }
        end = {"versions": versions(), "failures": trained.failures, PLURALS[self.kind]: policies}
        write_json(self.out / "run.json", rounded({**settings, **record, **end}))
        self.checkpoint.unlink(missing_ok=True)

    def report(self, trained: Trained, policies: list[Row]) -> int:
        """Print the policies and complain of failures; return the exit status."""
        if self.as_json:
            print_json({"out": str(self.out), PLURALS[self.kind]: policies})
        else:
            hidden = "sha256" if self.kind == "policy" else ""
            print_table([{k: v for k, v in row.items() if k != hidden} for row in policies])
        for failure in trained.failures:
            complain(failure)
        return 1 if trained.failures else 0


def described_file(path: Path) -> Row:
    """Return the name and the SHA-256 of a file, for run.json."""
    return {"file": str(path), "sha256": sha256_of_file(path)}
