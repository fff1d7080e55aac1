"""Files and commands of version 0.3.0 still work and give the numbers that they gave there."""

from __future__ import annotations

import contextlib
import io
import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from socialiq.cli.main import main

FOLDER = Path(__file__).parent / "v0_3_0"
"""Files that `make.py` made at version 0.3.0."""

ANSWERS: dict[str, dict[str, Any]] = json.loads((FOLDER / "answers.json").read_text())

CODE = {"bytes", "code", "package", "version", "socialiq", "date", "checked", "seconds", "timing"}
"""Keys whose values depend on the code or the day."""

AUDIT = "audit policy.safetensors --profile profile.toml --episodes 40 --seed 5 --out OUT/audit"

CHANGED = {
    "effects intersection-crosswalk-bicycles --policy gap_3s --episodes 4": (
        "Cyclists keep behind each other. Changes numbers: yes"
    ),
    **{
        f"evaluate scene_policy.safetensors --world {road} --episodes 4": (
            "Changes numbers: yes, `stopped` on other roads is the share of the decisions"
        )
        for road in ("merge", "roundabout")
    },
    AUDIT: "A report's words fit any environment. Changes numbers: no",
    "audit verify report": "A report's words fit any environment. Changes numbers: no",
}
"""Commands whose answers are others now, and the entry of the changelog that says so."""

CHANGED_STATUS = {"audit verify report": 3}
"""Their exit statuses, where those are others too."""

ROADS = ("intersection", "merge", "roundabout", "population", "train", "audit ")
"""Words of commands that take long."""


def _differences(before: Any, after: Any, place: str = "") -> list[str]:
    """Return where two results differ; a result may have further keys now."""
    if isinstance(before, dict):
        if not isinstance(after, dict):
            return [f"{place}: {before!r} -> {after!r}"]
        return [
            line
            for key, value in before.items()
            if key not in CODE
            for line in _differences(value, after.get(key, "missing"), f"{place}/{key}")
        ]
    if isinstance(before, list) and isinstance(after, list) and len(before) == len(after):
        pairs = zip(before, after, strict=True)
        return [
            line
            for number, (old, new) in enumerate(pairs)
            for line in _differences(old, new, f"{place}/{number}")
        ]
    equal = before == after
    if isinstance(before, float) and isinstance(after, int | float):
        equal = before == pytest.approx(after, abs=2e-6)
    return [] if equal else [f"{place}: {before!r} -> {after!r}"]


def _case(command: str) -> Any:
    """Return a command as a case; those that compile roads or train are slow."""
    is_long = any(word in command for word in ROADS) and "profile check" not in command
    return pytest.param(command, marks=[pytest.mark.slow] if is_long else [])


@pytest.mark.parametrize("command", [_case(command) for command in sorted(ANSWERS)])
def test_command_gives_the_answer_of_its_version(command, tmp_path, monkeypatch):
    files = tmp_path / "files"
    shutil.copytree(FOLDER, files)
    out = tmp_path / "out"
    out.mkdir()
    monkeypatch.chdir(files)
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        status = main([*command.replace("OUT", str(out)).split(), "--json"])
    answer = json.loads(printed.getvalue().replace(str(out), "OUT"))
    assert status == CHANGED_STATUS.get(command, ANSWERS[command]["status"])
    differences = _differences(ANSWERS[command]["answer"], answer)
    assert bool(differences) == (command in CHANGED), differences


@pytest.mark.parametrize("entry", CHANGED.values())
def test_changelog_says_that_numbers_changed(entry):
    changelog = (Path(__file__).parents[2] / "CHANGELOG.md").read_text()
    assert entry in " ".join(changelog.split())
