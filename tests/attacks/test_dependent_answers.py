"""A policy answers by something else than the observation.

By the size of the batch, by the row in it, by the number of requests so far, by the clock, or by
what its process drew when it was started. In an audit it drives as declared; elsewhere it drives
otherwise.
"""

import json
import shlex
import sys

import numpy as np
import pytest

from socialiq.cli.main import main
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.registry import make_grid
from socialiq.worlds.tabular_policy import TabularPolicy, expert_policy

POLICY = """
import functools, json, sys, time

@functools.cache
def life():  # number of this process, by a file
    with open(sys.argv[1] + ".lives", "a") as lives:
        lives.write(".")
        return lives.tell()

table = dict((tuple(state), action) for state, action in json.load(open(sys.argv[1])))
asked = 0
for line in sys.stdin:
    message = json.loads(line)
    if "protocol" in message:
        answer = {**message}
    else:
        asked += 1
        rows = message["observations"]
        actions = [table[tuple(row)] if RULE else 0 for place, row in enumerate(rows)]
        answer = {"id": message["id"], "actions": actions}
    print(json.dumps(answer), flush=True)
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A policy's table, and a declaration that it keeps."""
    folder = tmp_path_factory.mktemp("dependent")
    table = tabulate(make_grid("crossing7"))
    policy = TabularPolicy(table.world, expert_policy(table, 0.0, "stochastic"))
    states = table.reachable_part().states
    actions, _ = policy.predict(states.astype(np.float32))
    rows = zip(states.tolist(), np.asarray(actions).tolist(), strict=True)
    (folder / "table.json").write_text(json.dumps(list(rows)))
    new = ["profile", "new", "--world", "crossing7", "--angle", "0", "--margin", "2"]
    assert main([*new, "--out", str(folder / "profile.toml")]) == 0
    text = (folder / "profile.toml").read_text()
    for old in ("max_at_fault = 0.05", "max_struck = 0.1", "max_timeout = 0.2"):
        text = text.replace(old, f"{old.split()[0]} = 0.9")
    text = text.replace("min_arrival = 0.8", "min_arrival = 0.1")
    (folder / "profile.toml").write_text(text)
    return folder


@pytest.fixture
def audited(place, tmp_path):
    def run(rule, *more):
        policy, out = tmp_path / "policy.py", tmp_path / "out"
        policy.write_text(POLICY.replace("RULE", rule))
        command = [sys.executable, "-I", "-S", str(policy), str(place / "table.json")]
        words = [f"process:{shlex.join(command)}", "--profile", str(place / "profile.toml")]
        status = main(["audit", *words, "--episodes", "300", "--out", str(out), *more])
        return status, json.loads((out / "report.json").read_text())

    return run


def test_a_policy_of_observations_passes(audited):
    status, report = audited("True")
    assert status == 0
    found = report["consistency"]
    assert [found[name]["differing"] for name in ("repeated", "shuffled", "single")] == [0, 0, 0]
    assert found["single"]["queries"] >= 500


@pytest.mark.parametrize(
    ("rule", "found_by"),
    [
        ("len(rows) == 250", "shuffled"),
        ("place > 2", "shuffled"),
        ("asked <= 5", "repeated"),
        ("asked <= 50", "single"),
        ("time.monotonic_ns() // 1000 % 2", "repeated"),
        ("__import__('random').random() < 0.9", "repeated"),
    ],
)
def test_another_does_not_pass(audited, rule, found_by):
    status, report = audited(rule)
    assert status in (1, 3)
    assert report["consistency"][found_by]["differing"] > 0
    if status == 3:
        assert "answers depend on" in report["verdict"]["reason"]
        assert report["verdict"]["needed"] is None


def test_a_policy_that_drives_as_declared_in_its_first_processes_does_not_pass(audited):
    """300 episodes had one process, the questions another one; a third one was never started."""
    status, report = audited("life() <= 2", "--isolation", "none")
    assert status == 3 and "the process" in report["verdict"]["reason"]


def test_a_policy_that_draws_is_asked_again(audited):
    """With --soft nothing was asked again, and such a policy passed without a caveat."""
    often = "__import__('random').random() < 0.98"
    status, report = audited(often, "--soft")
    assert status == 0 and report["consistency"] is not None
    status, report = audited(f"len(rows) > 1 and {often}", "--soft", "--replace")
    assert status == 3 and "answers depend on the batch" in report["verdict"]["reason"]


def test_a_policy_that_drives_as_declared_in_large_batches_alone_does_not_pass(audited):
    status, report = audited("len(rows) > 1")
    assert (status, report["tests"]["regret"]["decision"]) == (3, "pass")
    assert report["consistency"]["single"]["differing"] > 0
    assert "answers depend on the batch" in report["verdict"]["reason"]
    assert report["verdict"]["needed"] is None
