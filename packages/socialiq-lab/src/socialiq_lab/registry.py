"""The studies by name: a folder `studies/NAME` with a STUDY.toml each.

The folder lies in the checkout, beside `packages`, or in the current folder; it is in no wheel.
STUDY.toml has a `title`, and declares the study (`socialiq_lab.declared`); or a module `study.py`
beside it ends with `STUDY` (`socialiq_lab.study.Study`). Its table `tiny` is the preset of that
name: other values of the configuration for a run of seconds.
"""

from __future__ import annotations

import functools
import importlib
import sys
import tomllib
from pathlib import Path
from typing import Any

from socialiq.errors import UserError, one_of
from socialiq.foreign import FAILURES, failure, imported
from socialiq_lab.declared import declared_study
from socialiq_lab.study import Study

DECLARATION = "STUDY.toml"


for _folder in (Path(__file__).parents[4], Path.cwd()):  # `import studies` finds either
    if (_folder / "studies").is_dir() and str(_folder) not in sys.path:
        sys.path.append(str(_folder))


@functools.cache
def declarations() -> dict[str, Path]:
    """Return the STUDY.toml of each study by name, in alphabetical order."""
    for folder in sys.path:
        paths = sorted(Path(folder).glob(f"studies/*/{DECLARATION}"))
        if paths:
            return {path.parent.name.replace("_", "-"): path for path in paths}
    return {}


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


STUDIES = tuple(declarations())
"""Names of all studies."""


def declaration(name: str) -> dict[str, Any]:
    """Return the content of a study's STUDY.toml.

    Raises:
        UserError: If there is no study of that name, or the file is damaged.
    """
    if name in RETIRED:
        raise UserError(
            f"{name} has retired: docs/studies/history.md has its results, and the tag "
            "before-the-split its code"
        )
    one_of("study", name, (*STUDIES, "STUDY.toml", "FILE.py:NAME"))
    return read(declarations()[name])


def read(path: Path) -> dict[str, Any]:
    """Read a STUDY.toml.

    Raises:
        UserError: If it is damaged, or has no title.
    """
    try:
        content = tomllib.loads(path.read_text())
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise UserError(f"{path}: {error}") from error
    if not isinstance(content.get("title"), str):
        raise UserError(f"{path} has no title: name the study in one line")
    return content


def study_and_declaration(name: str, allow_code: bool = False) -> tuple[Study, dict[str, Any]]:
    """Return a study by name, and the content of its STUDY.toml (empty for FILE.py:NAME).

    Args:
        name: One of `STUDIES`, the path of a STUDY.toml, or FILE.py:NAME.
        allow_code: Whether code of the user's own may run, with the user's rights.

    Raises:
        UserError: If there is none of that name, or its code may not run or fails.
    """
    if name.endswith(".toml"):
        path = Path(name)
        content = read(path)
        return declared_study(path.parent.name, content, _beside(path, allow_code)), content
    if name.rpartition(":")[0].endswith(".py"):
        return _of_file(name, allow_code), {}
    content = declaration(name)
    folder = declarations()[name].parent
    module: Any = None
    if (folder / "study.py").is_file():
        module = importlib.import_module(f"studies.{folder.name}.study")
    if hasattr(module, "STUDY"):
        return module.STUDY, content
    return declared_study(name, content, module), content


def find(name: str, allow_code: bool = False) -> Study:
    """Return a study by name, as `study_and_declaration`."""
    return study_and_declaration(name, allow_code)[0]


def _beside(path: Path, allow_code: bool) -> Any:
    """Return the module `study.py` beside a STUDY.toml of the user's; None if there is none."""
    file = path.parent / "study.py"
    if not file.is_file():
        return None
    _check_allowed(str(file), allow_code)
    return _run(str(file))


def _of_file(name: str, allow_code: bool) -> Study:
    """Return the study that a Python file of the user's defines."""
    file, _, attribute = name.rpartition(":")
    _check_allowed(name, allow_code)
    folder = str(Path(file).resolve().parent)
    if folder not in sys.path:
        sys.path.append(folder)  # the processes that run its jobs import the file by name
    study = getattr(_run(file), attribute, None)
    if not isinstance(study, Study):
        raise UserError(f"{file} has no study {attribute}: name a socialiq Study of the file")
    return study


def _check_allowed(name: str, allow_code: bool) -> None:
    if not allow_code:
        raise UserError(f"{name} would run its author's code: allow that with --allow-code")


def _run(file: str) -> Any:
    try:
        return imported(file)
    except UserError:
        raise
    except FAILURES as error:
        raise failure(file, error) from error
