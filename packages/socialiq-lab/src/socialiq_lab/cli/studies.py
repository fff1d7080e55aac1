"""`reproduce`: run a study, or show its results.

The settings of a study are the fields of its configuration. `--seeds`, `--set` and `--preset`
change them, and `--settings` lists them.
"""

import dataclasses
import inspect
import itertools
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import tyro

from socialiq import UserError
from socialiq import results_folder as store
from socialiq.cli.output import Display, Printing, print_json, print_table
from socialiq.errors import one_of
from socialiq.outputs import claimed
from socialiq.results_folder import Results
from socialiq.settings import assignments, changed, described
from socialiq_lab import registry
from socialiq_lab import study as experiment
from socialiq_lab.engine import Engine
from socialiq_lab.jobs import check_work
from socialiq_lab.study import Study


@dataclass(frozen=True)
class Reproduce(Printing):
    """Run a study, or show its results.

    `socialiq reproduce STUDY --settings` lists a study's settings. What is done is kept in
    FOLDER.work, so the same command resumes. The studies of the intersection take hours.

    Example: socialiq reproduce grid --seeds 0 1 --set updates=500 --out my-results
    """

    study: Annotated[str, tyro.conf.Positional] = ""
    """One of the studies above, or a table or figure of the thesis, "Table 6.1"; or a STUDY.toml or
    FILE.py:NAME, a study of your own."""
    allow_code: bool = False
    """Run the code of FILE.py, or of study.py beside STUDY.toml, with your rights."""
    seeds: tuple[int, ...] | None = None
    """Training seeds; by default those of the committed results."""
    set_: Annotated[
        tuple[tuple[str, ...], ...], tyro.conf.arg(name="set"), tyro.conf.UseAppendAction
    ] = ()
    """KEY=VALUE for each setting that differs from the committed results. The items of a list are
    divided by commas, strengths=1,3, or quoted in brackets, "methods=['a, b', 'c']"."""
    preset: str = ""
    """tiny: the smallest run that fills every table, in seconds or minutes."""
    settings: bool = False
    """List the study's settings with their values, and run nothing."""
    out: Path | None = None
    """Folder to write; by default ./results-STUDY."""
    work: Path | None = None
    """Folder of what is done, by default FOLDER.work."""
    engine: tyro.conf.OmitArgPrefixes[Engine] = field(default_factory=Engine)
    replace: bool = False
    """Replace the results that are in the folder."""
    from_: Annotated[Path | None, tyro.conf.arg(name="from")] = None
    """Show the results of this folder, or of the study's in it, without running anything; where
    ./results is not there, results/STUDY are those that came with the package. With --out the
    figures are drawn there."""

    output = None  # claimed in `_computed`, which knows the folder

    def run(self) -> int:
        """Run or read, then print."""
        if not self.study:
            raise UserError(f"name a study: {', '.join(registry.STUDIES)}; or your own STUDY.toml")
        study, content = registry.study_and_declaration(self.study, self.allow_code)
        if self.from_ is not None:
            results = experiment.load(study, self.from_)
            if self.out is not None:
                experiment.save(study, results, self.out, self.replace)
        else:
            config = self._config(study, content)
            if self.settings:
                print_table(described(config))
                return 0
            results = self._computed(study, config)
        if self.json:
            print_json({"study": results.study, "config": results.config} | results.summary)
        else:
            for view in study.view(results):
                print_table(view.rows, view.title)
        return 0

    def _config(self, study: Study, content: dict[str, Any]) -> Any:
        """Return the committed configuration with the preset and the settings laid over it."""
        config = study.Config()
        if self.preset:
            one_of("preset", self.preset, ("tiny",) if "tiny" in content else ())
            config = changed(config, content["tiny"])
        if self.seeds is not None:
            config = changed(config, {"seeds": self.seeds})
        return changed(config, assignments(list(itertools.chain.from_iterable(self.set_))))

    def _computed(self, study: Study, config: Any) -> Results:
        """Run what is not done yet, with its progress shown, and write the folder."""
        _check(config)
        folder = self.out or Path(f"results-{study.name}")
        with claimed(folder), Display() as display:
            store.check_target(folder, self.replace)
            work = self.work or folder.with_name(f"{folder.name}.work")
            check_work(work)
            results = experiment.run(study, config, display.stage, work, self.engine)
            experiment.save(study, results, folder, self.replace)
        return results


def _check(config: Any) -> None:
    """Refuse seeds, counts and names that make no run, before hours are spent on one."""
    from socialiq.cli.words import check_options
    from socialiq.learners.settings import check_seeds
    from socialiq.social.returns import TARGET_KINDS

    check_seeds(getattr(config, "seeds", ()))
    if getattr(config, "seeds", None) == ():
        raise UserError("name at least one seed")
    try:
        check_options(config)
    except UserError as error:
        raise UserError(f"--set {str(error).removeprefix('--')}") from error
    if getattr(config, "episodes", 1) < 1:
        raise UserError(f"episodes must be at least 1, got {config.episodes}")
    for kind in getattr(config, "target_kinds", ()):
        one_of("target kind", kind, (*TARGET_KINDS, "advantage"))
    for field_of_config in dataclasses.fields(config):
        value = getattr(config, field_of_config.name)
        if isinstance(value, int) and value < 0:
            raise UserError(f"{field_of_config.name} must be at least 0, got {value}")


def _listed() -> str:
    """Return the name and the title of each study, one a line."""
    titles = registry.thesis_first()
    width = max(map(len, titles), default=0)
    return "\n".join(f"  {name.ljust(width)}  {title}" for name, title in titles.items())


Reproduce.__doc__ = f"{inspect.cleandoc(Reproduce.__doc__ or '')}\n\nStudies:\n{_listed()}\n"
