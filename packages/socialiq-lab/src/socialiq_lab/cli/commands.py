"""Commands of the laboratory, which `socialiq` finds by an entry point; `claims` and `bench`."""

import importlib.util
import textwrap
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Annotated

import tyro

import socialiq
from socialiq import UserError
from socialiq.cli.output import Printing, print_json, print_table
from socialiq.errors import one_of
from socialiq.storage import shipped
from socialiq.types import Row
from socialiq_lab import claims

COMMANDS = {
    "demo": "socialiq_lab.cli.demo:Demo",
    "sweep": "socialiq_lab.cli.sweep:Sweep",
    "reproduce": "socialiq_lab.cli.studies:Reproduce",
    "claims": "socialiq_lab.cli.commands:Claims",
    "bench": "socialiq_lab.cli.commands:Bench",
}
"""Module and class of each command."""


@dataclass(frozen=True)
class Claims(Printing):
    """Print each checkable claim of the thesis, the value found, and the verdict.

    Example: socialiq claims --verdict not
    """

    results: Path = Path("results")
    """Folder that holds a folder of each STUDY, as that of the checkout."""
    verdict: str = ""
    """Only this verdict: reproduced, adopted (a setting typed in), partly, not or untested."""
    study: str = ""
    """Only claims tested by this study."""

    def run(self) -> int:
        """Resolve the values and print."""
        rows = claims.ledger(shipped(self.results))
        if self.verdict:
            one_of("verdict", self.verdict, claims.VERDICTS)
            rows = [row for row in rows if row["verdict"] == self.verdict]
        if self.study:
            one_of("study", self.study, claims.STUDIES)
            rows = [row for row in rows if row["study"] == self.study]
        counts = claims.count(rows)
        if self.json:
            print_json({"counts": counts, "claims": rows})
            return 0
        for row in rows:
            print(described(row))
        print(", ".join(f"{number} {verdict}" for verdict, number in counts.items()))
        if counts["not"]:
            print(claims.failing(rows))
        return 0


def described(row: Row) -> str:
    """Return a claim as a short paragraph."""
    lines = [f"[{row['verdict']}] {row['id']} ({row['place']})", row["statement"]]
    lines += [f"thesis: {row['thesis']}"]
    lines += [f"ours: {row['ours']}"] if row["ours"] else []
    lines += [f"under: {row['conditions']}"] if row["conditions"] else []
    lines += [f"because: {row['reason']}"] if row["reason"] else []
    lines += [f"cause: {row['cause']}"] if row["cause"] else []
    if row["matched"]:
        verdict = row["verdict_matched"]
        lines += [f"with experts like the thesis' [{verdict}]: {row['matched']}"]
        lines += ["command: socialiq reproduce expert-strength"]
    if row["caused"]:
        lines += [f"by what is caused [{row['verdict_caused']}]: {row['caused']}"]
    where = " (in a checkout, after `make test`)" if row["command"].startswith("pytest ") else ""
    lines += [f"command: {row['command']}{where}"] if row["command"] else []
    wrapped = [lines[0], *(textwrap.fill(line, 96) for line in lines[1:])]
    return textwrap.indent("\n".join(wrapped), "  ")[2:] + "\n"


BENCHMARKS = (
    "learners", "continuous", "devices", "worlds", "experts", "dial", "recordings", "page",
    "junction",
)  # fmt: skip


@dataclass(frozen=True)
class Bench(Printing):
    """Measure speed in comparison with reference implementations.

    learners: against eager PyTorch. continuous: soft actor-critic against Stable-Baselines3's.
    devices: a GPU against the processor. worlds: against highway-env. experts: deep Q-learning
    against Stable-Baselines3 on highway-env. dial: against one run of the thesis' learner.
    recordings: import of recorded traffic, against commonroad-io if SOCIALIQ_COMMONROAD_PYTHON has
    it. page: the core as WebAssembly in Node, against the native one. junction: decisions a second
    of a recorded junction.

    Example: socialiq bench worlds
    """

    benchmark: Annotated[str, tyro.conf.Positional]
    """learners, continuous, devices, worlds, experts, dial, recordings, page or junction."""
    repeats: int = 3
    """Runs of each side, in turn; medians and their ratios are printed."""

    def run(self) -> int:
        """Find the benchmark in the checkout of the sources, run it, print."""
        one_of("benchmark", self.benchmark, BENCHMARKS)
        if self.repeats < 1:
            raise UserError(f"repeats must be at least 1, got {self.repeats}")
        measured = load(self.benchmark).run(self.repeats)
        if self.json:
            print_json(measured)
        else:
            print_table([{"measured": name, "value": value} for name, value in measured.items()])
        return 0


def load(name: str) -> ModuleType:
    """Return a benchmark of the checkout, as a module.

    Raises:
        UserError: In an installed package, which has no benchmarks.
    """
    up = Path(socialiq.__file__).parents[4:5]
    path = next((folder / "benchmarks" / f"{name}.py" for folder in up), None)
    if path is None or not path.is_file():
        raise UserError("benchmarks come with the sources, not the package: run in a checkout")
    spec = importlib.util.spec_from_file_location(f"benchmarks_{name}", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
