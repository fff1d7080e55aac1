"""`reproduce` and `compare`: run a study, or show its results.

The options of a study follow from its own `Config`. `specific` returns a command for one study, so
that only this study is imported, and `declared_options` reads them from the study's source, so that
a mistyped one is refused without an import.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import tyro

from socialiq.cli import declared
from socialiq.cli.output import print_json, print_table
from socialiq.cli.progress import Display
from socialiq.errors import UserError, one_of
from socialiq.outputs import claimed
from socialiq_lab import results as store
from socialiq_lab import study as experiment
from socialiq_lab.engine import Engine
from socialiq_lab.registry import STUDIES, find, module_of
from socialiq_lab.results import Results
from socialiq_lab.study import Study

COMPARISONS = {"priors": "compare-priors", "methods": "compare-methods"}
"""Name on the command line, and the study."""


@dataclass(frozen=True)
class _StudyCommand:
    """Options of every study."""

    out: Path | None = None
    """Folder to write; by default ./results-STUDY."""
    work: Path | None = None
    """Folder of what is done, by default FOLDER.work; only studies with jobs keep one."""
    engine: tyro.conf.OmitArgPrefixes[Engine] = field(default_factory=Engine)
    replace: bool = False
    """Replace the results that are in the folder."""
    from_: Annotated[Path | None, tyro.conf.arg(name="from")] = None
    """Show the results of this folder, or of the study's in it, without running anything; where
    ./results is not there, results/STUDY are those that came with the package."""
    json: bool = False
    """Print one JSON object."""

    output = None  # claimed in `_computed`, which knows the folder
    config = None  # of the study, in the commands that `_specific` makes

    @classmethod
    def named(cls, arguments: Sequence[str]) -> str:
        """Return the study that the arguments name, or "" if they name none."""
        raise NotImplementedError

    @classmethod
    def declared_options(cls, arguments: Sequence[str]) -> list[str] | None:
        """Return the options by the sources, without dashes; None for a study of the user's."""
        study = cls.named(arguments)
        own = declared.options(cls.__module__, cls.__name__)
        if not study:
            return own
        below = None if ".py:" in study else declared.options(module_of(study), "Config")
        return None if own is None or below is None else own + below

    @classmethod
    def specific(cls, arguments: Sequence[str]) -> type[Any]:
        """Return the command with the options of the study that the arguments name."""
        study = cls.named(arguments)
        return _specific(cls, find(study, "--allow-code" in arguments)) if study else cls

    def run_study(self, study: Study) -> int:
        """Run or read, then print."""
        if self.from_ is not None:
            results = experiment.load(study, self.from_)
        else:
            results = self._computed(study)
        if self.json:
            print_json({"study": results.study, "config": results.config} | results.summary)
        else:
            for view in study.view(results):
                print_table(view.rows, view.title)
        return 0

    def _computed(self, study: Study) -> Results:
        """Run what is not done yet, with its progress shown, and write the folder."""
        config = self.config or study.Config()
        _check(config)
        folder = self.out or Path(f"results-{study.name}")
        if self.work is not None and not study.is_resumable:
            raise UserError(f"{study.name} keeps no work folder: leave out --work")
        if self.engine.given and not study.is_resumable:
            raise UserError(f"{study.name} has no jobs: leave out --processes and --cluster")
        with claimed(folder), Display() as display:
            store.check_target(folder, self.replace)
            work = self.work or folder.with_name(f"{folder.name}.work")
            results = experiment.run(study, config, display.stage, work, self.engine)
            experiment.save(study, results, folder, self.replace)
        return results


def _check(config: Any) -> None:
    """Refuse seeds, counts and names that make no run, before hours are spent on one.

    Raises:
        UserError: If there are any.
    """
    from socialiq.learners.config import check_seeds
    from socialiq.social.returns import TARGET_KINDS

    check_seeds(getattr(config, "seeds", ()))
    if getattr(config, "seeds", None) == ():
        raise UserError("name at least one seed")
    if getattr(config, "episodes", 1) < 1:
        raise UserError(f"episodes must be at least 1, got {config.episodes}")
    for kind in getattr(config, "target_kinds", ()):
        one_of("target kind", kind, (*TARGET_KINDS, "advantage"))
    for one in dataclasses.fields(config):
        value = getattr(config, one.name)
        if isinstance(value, int) and value < 0:
            raise UserError(f"{one.name} must be at least 0, got {value}")


@dataclass(frozen=True)
class Reproduce(_StudyCommand):
    """Run a study of the thesis: worlds (5.1) to intersection (6.3, A), or an appendix.

    `socialiq reproduce STUDY --help` lists a study's own options. The long studies, those of the
    intersection, take hours; they keep what is done in FOLDER.work, so the same command resumes.

    Example: socialiq reproduce grid --seeds 0 1 --out my-results
    """

    study: Annotated[str, tyro.conf.Positional] = ""
    """worlds, intersection-world, poc, grid, intersection, alternatives (appendix B), lambda-sweep
    (D); theory, its predictions against training; dial, intersection-dial, intersection-offline and
    intersection-continuous, which go beyond it; audits of its tables and of our policies,
    audit-power, what an audit is worth; classic-control and mujoco-imitation, outside checks;
    compare-priors; compare-methods; recorded-junction-practice, a dial of recordings; or
    FILE.py:NAME, a study of your own."""
    allow_code: bool = False
    """Run the code of FILE.py, with your rights."""

    @classmethod
    def named(cls, arguments: Sequence[str]) -> str:
        """Return the study that the arguments name, or "" if they name none."""
        if arguments and not arguments[0].startswith("-"):
            return arguments[0]
        return next((word for word in arguments if word in STUDIES or ".py:" in word), "")

    def run(self) -> int:
        """Run or read, then print."""
        return self.run_study(find(self.study, self.allow_code))


@dataclass(frozen=True)
class Compare(_StudyCommand):
    """Compare at one budget every place where the prior can enter, or our methods with others'.

    Settings are chosen on development seeds, the table is of other seeds. What is done is kept in
    FOLDER.work, so the same command resumes. Methods of other libraries run in environments that
    are made there with pip; `--methods` without them needs none.

    Example: socialiq compare priors --worlds crossing7 --out my-comparison
    """

    comparison: Annotated[str, tyro.conf.Positional] = ""
    """priors or methods."""

    @classmethod
    def named(cls, arguments: Sequence[str]) -> str:
        """Return the study of the comparison that the arguments name, or "" if they name none."""
        if arguments and not arguments[0].startswith("-"):
            one_of("comparison", arguments[0], tuple(COMPARISONS))
        return next((COMPARISONS[word] for word in arguments if word in COMPARISONS), "")

    def run(self) -> int:
        """Run or read, then print."""
        one_of("comparison", self.comparison, tuple(COMPARISONS))
        return self.run_study(find(COMPARISONS[self.comparison]))


def _specific(command: type[Any], study: Study) -> type[Any]:
    """Return a command that also has the fields of a study's configuration."""
    options = (
        "config",
        Annotated[study.Config, tyro.conf.arg(name="")],
        field(default_factory=study.Config),
    )
    named = {"__doc__": command.__doc__}
    return dataclasses.make_dataclass(
        command.__name__, [options], bases=(command,), namespace=named, frozen=True
    )
