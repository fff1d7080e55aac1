"""Bubblewrap is not installed, so the policy had the rights of the audit: a reader may overlook it.

The audit runs all the same, and says on its first screen that the evidence is self-attested; an
auditor who requires isolation gets no verdict at all.
"""

import json
import shlex
import sys

import pytest

from socialiq.cli.main import main

POLICY = """
import json, sys
for line in sys.stdin:
    message = json.loads(line)
    if "protocol" in message:
        answer = message
    else:
        answer = {"id": message["id"], "actions": [0 for _ in message["observations"]]}
    print(json.dumps(answer), flush=True)
"""


@pytest.fixture
def words(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", "")  # the interpreter is named by its path
    (tmp_path / "policy.py").write_text(POLICY)
    profile = tmp_path / "profile.toml"
    new = ["profile", "new", "--world", "crossing5", "--angle", "45", "--margin", "1"]
    assert main([*new, "--out", str(profile)]) == 0
    command = shlex.join([sys.executable, "-I", "-S", str(tmp_path / "policy.py")])
    return ["audit", f"process:{command}", "--profile", str(profile), "--episodes", "30"]


def test_the_first_screen_says_so(tmp_path, words, capsys):
    out = tmp_path / "out"
    assert main([*words, "--out", str(out)]) == 1
    said = "not isolated (bubblewrap is not installed)"
    assert said in capsys.readouterr().out
    report = json.loads((out / "report.json").read_text())
    assert report["policy"]["record"]["isolation"]["kind"] == "none"
    for page in ("report.html", "report.md"):
        text = (out / page).read_text().replace("\\", "")
        assert said in text[: text.index("Record")]


def test_isolation_can_be_required(tmp_path, words, capsys):
    assert main([*words, "--isolation", "required", "--out", str(tmp_path / "out")]) == 2
    assert "isolation is required, but bubblewrap is not installed" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
