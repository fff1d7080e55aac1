"""A policy answers by something else than the observation.

By the size of the batch, by the row in it, by the number of requests so far, or by the clock. In an
audit it drives as declared; elsewhere it drives otherwise.
"""

import datetime
import json
import shlex
import sys

import pytest

from socialiq.audit.profile.profile import Floor, Margin
from socialiq.audit.profile.template import declare
from socialiq.cli.main import main

POLICY = """
import json, sys, time
asked, began = 0, time.monotonic()
for line in sys.stdin:
    message = json.loads(line)
    if "protocol" in message:
        answer = {**message}
    else:
        asked += 1
        rows = message["observations"]
        actions = [RULE for place, row in enumerate(rows)]
        answer = {"id": message["id"], "actions": actions}
    print(json.dumps(answer), flush=True)
"""


@pytest.fixture
def audited(tmp_path):
    profile = tmp_path / "profile.toml"
    floor = Floor(max_at_fault=0.99, max_struck=0.99, min_arrival=0.0, max_timeout=0.99)
    declared = (45.0, "An owner", "crossing7", Margin(100.0, 10.0), datetime.date(2026, 1, 31))
    profile.write_bytes(declare(*declared, competence=floor).source)

    def run(rule):
        (tmp_path / "policy.py").write_text(POLICY.replace("RULE", rule))
        command = shlex.join([sys.executable, "-I", "-S", str(tmp_path / "policy.py")])
        words = [f"process:{command}", "--profile", str(profile), "--episodes", "200"]
        status = main(["audit", *words, "--out", str(tmp_path / "out"), "--replace"])
        return status, json.loads((tmp_path / "out" / "report.json").read_text())

    return run


def test_a_policy_of_observations_passes(audited):
    status, report = audited("int(row[0] > 2)")
    assert status == 0
    found = report["consistency"]
    assert [found[name]["differing"] for name in ("repeated", "shuffled", "single")] == [0, 0, 0]
    assert found["single"]["queries"] >= 500


@pytest.mark.parametrize(
    ("rule", "found_by"),
    [
        ("1 if len(rows) > 1 else 2", "single"),
        ("1 if len(rows) == 200 else 2", "shuffled"),
        ("1 if place < 100 else 2", "single"),
        ("1 if place % 2 else 2", "shuffled"),
        ("1 if asked <= 9 else 2", "repeated"),
        ("1 if time.monotonic() < began + 0.05 else 2", "repeated"),
        ("hash(time.time()) % 2", "repeated"),
        ("int(__import__('random').random() < 0.5)", "repeated"),
    ],
)
def test_another_does_not_pass(audited, rule, found_by):
    status, report = audited(rule)
    assert (status, report["verdict"]["decision"]) == (3, "inconclusive")
    assert report["consistency"][found_by]["differing"] > 0
    assert "depend" in report["verdict"]["reason"]
    assert report["verdict"]["needed"] is None
