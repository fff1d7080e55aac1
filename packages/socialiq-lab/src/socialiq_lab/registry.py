"""The studies by name: a folder `studies/NAME` with a STUDY.toml each.

The folder lies in the checkout, next to `packages`, or in the current folder; it is in no wheel.
STUDY.toml has a `title`, and declares the study (`socialiq_lab.declared`); or a module `study.py`
of its folder ends with `STUDY` (`socialiq_lab.study.Study`). Its table `tiny` is the preset of that
name: other values of the configuration for a run of seconds. A study of the thesis lists in
`of_the_thesis` the tables and figures of the thesis that it makes.
"""

import functools
import importlib
import sys
import tomllib
from pathlib import Path
from typing import Any

from socialiq import UserError
from socialiq.errors import one_of
from socialiq.foreign import FAILURES, failure, imported
from socialiq_lab.declared import declared_study
from socialiq_lab.study import Study

DECLARATION = "STUDY.toml"


for _folder in (*Path(__file__).parents[4:5], Path.cwd()):  # `import studies` finds either
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
    "angle-trait",
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


def thesis_first() -> dict[str, str]:
    """Return the title of each study by name, those of the thesis first."""
    contents = {name: read(path) for name, path in declarations().items()}
    names = sorted(contents, key=lambda name: "of_the_thesis" not in contents[name])
    return {name: contents[name]["title"] for name in names}


def study_of(printed: str) -> str:
    """Return the study that makes a table or figure of the thesis, such as "Table 6.1".

    Args:
        printed: Name of a table or figure; another text is returned as it is.
    """
    for name, path in declarations().items():
        if printed.casefold() in map(str.casefold, read(path).get("of_the_thesis", ())):
            return name
    return printed


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
        allow_code: Whether a user's code may run, with the user's rights.

    Raises:
        UserError: If there is none of that name, or its code may not run or fails.
    """
    module: Any = None
    if name.endswith(".toml"):
        path = Path(name)
        content = read(path)
        beside = path.parent / "study.py"
        if beside.is_file():
            module = _run(str(beside), str(beside), allow_code)
        return declared_study(path.parent.name, content, module), content
    file, _, attribute = name.rpartition(":")
    if file.endswith(".py"):
        study = getattr(_run(file, name, allow_code), attribute, None)
        if not isinstance(study, Study):
            raise UserError(f"{file} has no study {attribute}: name a socialiq Study of the file")
        return study, {}
    name = study_of(name)
    content = declaration(name)
    folder = declarations()[name].parent
    if (folder / "study.py").is_file():
        module = importlib.import_module(f"studies.{folder.name}.study")
    if hasattr(module, "STUDY"):
        return module.STUDY, content
    return declared_study(name, content, module), content


def find(name: str, allow_code: bool = False) -> Study:
    """Return a study by name.

    Args:
        name: One of `STUDIES`, the path of a STUDY.toml, or FILE.py:NAME.
        allow_code: Whether a user's code may run, with the user's rights.

    Raises:
        UserError: If there is none of that name, or its code may not run or fails.
    """
    return study_and_declaration(name, allow_code)[0]


def _run(file: str, name: str, allow_code: bool) -> Any:
    """Run a Python file of the user's, if that is allowed."""
    if not allow_code:
        raise UserError(f"{name} would run its author's code: allow that with --allow-code")
    folder = str(Path(file).resolve().parent)
    if folder not in sys.path:
        sys.path.append(folder)  # the processes that run its jobs import the file by name
    try:
        return imported(file)
    except UserError:
        raise
    except FAILURES as error:
        raise failure(file, error) from error
