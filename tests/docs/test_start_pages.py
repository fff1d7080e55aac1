"""The commands of the pages under Start run as they stand there, in one folder."""

import importlib.util
import re
import shlex
from pathlib import Path

import pytest

from socialiq.cli.main import main

ROOT = Path(__file__).parents[2]
PAGES = ("start.md", "first-audit.md", "first-recording.md")

pytestmark = pytest.mark.usefixtures("as_a_user_runs_it")


@pytest.mark.slow
def test_the_commands_do_what_they_say(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for folder in ("results", "examples"):
        Path(folder).symlink_to(ROOT / folder)
    text = "".join((ROOT / "docs" / page).read_text() for page in PAGES)
    # That of start.md runs in `test_pages`; the other one is the driver of the first audit.
    _, careful = re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    Path("careful.py").write_text(careful)
    commands = re.findall(r"^\$ socialiq (.*)$", text, re.MULTILINE)
    assert len(commands) == 18
    for command in commands:
        words = shlex.split(command)
        lacks_maps = words[:2] == ["data", "conflicts"] and not importlib.util.find_spec("shapely")
        assert main(words) == (2 if lacks_maps else 0), capsys.readouterr().err
        printed = capsys.readouterr()
        assert not lacks_maps or "socialiq-recordings[maps]" in printed.err
    assert Path("dial-page/index.html").exists() and Path("audit/report.html").exists()
    assert {path.suffix for path in Path().glob("episode.*")} == {".gif", ".png"}


@pytest.mark.slow
def test_the_commands_of_the_thesis_learner_s_page_run(tmp_path, monkeypatch, capsys):
    """Those of the gridworld as they stand, those of the intersection shorter."""
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "docs" / "regularised-iq-learn.md").read_text()
    commands = re.findall(r"^\$ socialiq (.*)$", text, re.MULTILINE)
    assert len(commands) == 12
    for command in commands:
        words = [word.replace("1000", "20").replace("500", "20") for word in shlex.split(command)]
        fewer = ["--updates", "2"] if words[0] == "train" and "intersection" in words else []
        assert main([*words, *fewer]) == 0, capsys.readouterr().err
    assert {path.name for path in Path().glob("*.png")} == {
        f"{name}.png" for name in ("ring", "stops", "sweep", "roads")
    }
