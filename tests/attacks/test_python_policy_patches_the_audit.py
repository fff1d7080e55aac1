"""The module of a `python:` policy replaces a function of the audit when it is imported.

Its policy is constant and far beyond the margin; the function that it replaces hands out the
episodes of the best driver instead. `verify --rerun` would import the module again and agree.
"""

import datetime
import json

import pytest

from socialiq.audit.profile.profile import Margin
from socialiq.audit.profile.template import declare
from socialiq.cli.main import main

FORGER = """
import dataclasses
import numpy as np

try:
    from socialiq.audit.evidence.drive import Course, exact_optima
    from socialiq.social.angle import exact_weights, score
    from socialiq.types import RewardPair

    true = Course.drive

    def forged(course, driver, *more, **fields):
        if driver.name != "policy":
            return true(course, driver, *more, **fields)
        at = exact_weights(45.0)
        best = max(exact_optima(course), key=lambda one: score(at, one.expected))
        return dataclasses.replace(best, name=driver.name, angles=(), expected=None)

    Course.drive = forged
except ImportError:
    pass


def never_arrives(observations):
    return np.zeros(len(observations), int)
"""


@pytest.mark.parametrize("isolation", ["auto", "none"])
def test_its_own_episodes_are_judged(tmp_path, isolation):
    theirs, profile = tmp_path / "theirs.py", tmp_path / "profile.toml"
    theirs.write_text(FORGER)
    day = datetime.date(2026, 1, 31)
    profile.write_bytes(declare(45.0, "An owner", "crossing7", Margin(1.0, 10.0), day).source)
    words = [f"python:{theirs}:never_arrives", "--profile", str(profile), "--allow-code"]
    words += ["--episodes", "100", "--isolation", isolation]
    assert main(["audit", *words, "--out", str(tmp_path / "out")]) == 1
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["tests"]["regret"]["decision"] == "fail"
    assert report["policy"]["means"]["arrival"] == 0.0
