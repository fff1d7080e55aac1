"""The page on many runs: its commands parse, and its sweep file is in order."""

import re
import shlex
from pathlib import Path

from socialiq.cli.main import parse
from socialiq_lab.sweep.plan import read_plan

PAGE = (Path(__file__).parents[2] / "docs" / "scale.md").read_text()


def test_its_commands_parse():
    found = re.findall(r"^\$ socialiq (.*)$", PAGE, re.MULTILINE)
    assert len(found) == 6
    for words in found:
        assert parse(shlex.split(words)) is not None


def test_its_sweep_file_is_read(tmp_path):
    [text] = re.findall(r"^```toml\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    (tmp_path / "sweep.toml").write_text(text)
    (tmp_path / "mixed.safetensors").touch()
    jobs = read_plan(tmp_path / "sweep.toml").jobs
    runs = [one for job in jobs for one in job.config.hyperparameters]
    assert (len(jobs), len(runs)) == (2, 2 * 3 * 2 * 3)
