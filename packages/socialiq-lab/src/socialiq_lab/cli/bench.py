"""`bench`: speed compared with reference implementations, measured in one run."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Annotated

import tyro

import socialiq
from socialiq.cli.output import Printing, print_json, print_table
from socialiq.errors import UserError, one_of

BENCHMARKS = (
    "learners",
    "continuous",
    "devices",
    "worlds",
    "experts",
    "dial",
    "recordings",
    "page",
    "junction",
)


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
        """Find the benchmark beside the sources, run it, print."""
        one_of("benchmark", self.benchmark, BENCHMARKS)
        if self.repeats < 1:
            raise UserError(f"repeats must be at least 1, got {self.repeats}")
        path = load(self.benchmark).run(self.repeats)
        if self.json:
            print_json(path)
        else:
            print_table([{"measured": name, "value": value} for name, value in path.items()])
        return 0


def load(name: str) -> ModuleType:
    """Return a benchmark of the checkout, as a module.

    Raises:
        UserError: In an installed package, which has no benchmarks.
    """
    path = Path(socialiq.__file__).parents[4] / "benchmarks" / f"{name}.py"
    if not path.is_file():
        raise UserError("benchmarks come with the sources, not the package: run in a checkout")
    spec = importlib.util.spec_from_file_location(f"benchmarks_{name}", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
