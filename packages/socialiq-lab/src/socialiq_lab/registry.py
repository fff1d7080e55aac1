"""The studies by name; each is imported at its first use.

A study is a module of the folder `studies` that ends with `STUDY` (`socialiq_lab.study.Study`) and
defines or imports `Config`, the module `study` of a folder where it is larger, and one line below.
The folder is in no wheel: it lies in the checkout, beside `packages`, or in the current folder.
"""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

from socialiq.errors import UserError, one_of
from socialiq.foreign import FAILURES, failure, imported
from socialiq_lab.study import Study

STUDIES = {
    "worlds": "worlds",
    "poc": "poc",
    "grid": "grid.study",
    "lambda-sweep": "lambda_sweep",
    "alternatives": "alternatives",
    "penalties": "penalties",
    "dial": "dial.study",
    "off-policy": "off_policy",
    "intersection-world": "intersection_world",
    "intersection": "intersection.study",
    "intersection-dial": "intersection_dial.study",
    "intersection-offline": "intersection_offline.study",
    "intersection-continuous": "intersection_continuous.study",
    "audit-power": "audit_power.study",
    "audits": "audits.study",
    "angle-trait": "angle_trait.study",
    "recorded-junction-practice": "recorded_junction.study",
    "theory": "theory.study",
    "classic-control": "classic_control.study",
    "mujoco-imitation": "mujoco_imitation.study",
    "compare-priors": "compare_priors.study",
    "compare-methods": "compare_methods.study",
    "mo-gymnasium": "mo_gymnasium.study",
}
"""Name on the command line, and the study's module."""

RETIRED = (
    "angle-zeros",
    "competence",
    "context",
    "intersection-ahead",
    "intersection-networks",
    "intersection-policy-iteration",
    "intersection-skill",
    "recorded-junction",
    "recorded-junction-ahead",
    "roads",
)
"""Studies of the tag `before-the-split`; docs/studies/history.md has their results."""


def add_studies_to_path() -> None:
    """Make `import studies` find the folder of this checkout, or that of the current folder."""
    for folder in (Path(__file__).parents[4], Path.cwd()):
        if (folder / "studies" / "__init__.py").is_file() and str(folder) not in sys.path:
            sys.path.append(str(folder))


add_studies_to_path()


def module_of(name: str) -> str:
    """Return the full name of a study's module.

    Raises:
        UserError: If there is no study of that name.
    """
    if name in RETIRED:
        raise UserError(
            f"{name} has retired: docs/studies/history.md has its results, and the tag "
            "before-the-split its code"
        )
    one_of("study", name, (*STUDIES, "FILE.py:NAME"))
    return f"studies.{STUDIES[name]}"


def find(name: str, allow_code: bool = False) -> Study:
    """Return a study by name.

    Args:
        name: One of `STUDIES`, or FILE.py:NAME for a study of the user's own.
        allow_code: Whether a file's code may run, with the user's rights.

    Raises:
        UserError: If there is none of that name, or its code may not run or fails.
    """
    file, _, attribute = name.rpartition(":")
    if not file.endswith(".py"):
        return importlib.import_module(module_of(name)).STUDY
    if not allow_code:
        raise UserError(f"{name} would run its author's code: allow that with --allow-code")
    folder = str(Path(file).resolve().parent)
    if folder not in sys.path:
        sys.path.append(folder)  # the processes that run its jobs import the file by name
    try:
        study = getattr(imported(file), attribute, None)
    except UserError:
        raise
    except FAILURES as error:
        raise failure(name, error) from error
    if not isinstance(study, Study):
        raise UserError(f"{file} has no study {attribute}: name a socialiq Study of the file")
    return study
