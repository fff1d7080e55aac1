"""The commands of docs/add-a-study.md run as they stand there, one after another."""

import re
import shlex
from pathlib import Path

import pytest

from socialiq.cli.main import main

PAGE = (Path(__file__).parents[2] / "docs" / "add-a-study.md").read_text()


def block(language, number=0):
    """Return a block of code of the page."""
    blocks = re.findall(rf"^```{language}\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    return blocks[number]


def outputs_of(commands, capsys):
    """Run the commands of a block; return what each printed."""
    printed = []
    for program, *words in map(shlex.split, commands.splitlines()):
        assert program == "socialiq"
        assert main(words) == 0, capsys.readouterr().err
        printed.append(capsys.readouterr().out)
    return printed


@pytest.mark.slow
def test_the_declared_study_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("discounts").mkdir()
    Path("discounts/STUDY.toml").write_text(block("toml"))
    first, again, other, settings = outputs_of(block("console"), capsys)
    assert "regret at 0 degrees" in first and again == first
    assert len(Path("found/policies.csv").read_text().splitlines()) == 1 + 2 * 2
    assert [line.split(",")[:2] for line in Path("other/pooled.csv").read_text().splitlines()][
        1:
    ] == [["1.0", "greedy"], ["1.0", "soft"], ["2.0", "greedy"], ["2.0", "soft"]]
    assert other != first and "strengths" in settings and "0.3,3" in settings
    assert Path("found/regret.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_the_study_with_jobs_resumes(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("optima.py").write_text(block("python"))
    printed, solved = [], []
    for command in block("console", 1).splitlines():
        printed += outputs_of(command, capsys)
        solved.append({p.parent.name: p.stat().st_mtime_ns for p in Path().rglob("job.json")})
    assert "largest mean total" in printed[0] and printed[1] == printed[0]
    assert set(solved[1]) == {"0", "45", "90"} and set(solved[2]) == {"0", "45", "90", "30"}
    assert solved[1] == {name: solved[2][name] for name in solved[1]}  # none was solved again
    lines = Path("finer/optima.csv").read_text().splitlines()
    assert lines[0] == "angle,value" and [line.split(",")[0] for line in lines[1:]] == [
        "0.0",
        "30.0",
    ]
    assert Path("optima/optima.png").read_bytes().startswith(b"\x89PNG")
