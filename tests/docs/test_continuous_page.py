"""The commands of docs/continuous.md run as they stand there, one after another."""

import re
import shlex
from pathlib import Path

import pytest

from socialiq.cli.main import main

PAGE = (Path(__file__).parents[2] / "docs" / "continuous.md").read_text()

pytestmark = pytest.mark.usefixtures("as_a_user_runs_it")


@pytest.mark.slow
def test_the_commands_do_what_they_say(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    first = re.search(r"^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    blocks = re.findall(r"^```console\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    assert first and blocks
    exec(first[1], {})
    commands = "".join(blocks).replace("\\\n", " ").splitlines()
    assert len(commands) == 12
    for line in commands:
        program, *words = shlex.split(line)
        assert program == "socialiq"
        assert main(words) == 0, capsys.readouterr().err
    assert Path("dial/dial_0.safetensors").exists() and Path("td3/run.json").exists()
