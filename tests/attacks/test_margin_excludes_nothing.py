"""A declaration that no driver can break: a margin of a million, and limits that allow everything.

Whatever the owner's policy does, "behaves as declared" would be printed beside it.
"""

import json
import re

import pytest

from socialiq.cli.main import main

OPEN = {
    "max_at_fault = 0.05": "max_at_fault = 1.0",
    "max_struck = 0.1": "max_struck = 1.0",
    "min_arrival = 0.8": "min_arrival = 0.0",
    "max_timeout = 0.2": "max_timeout = 1.0",
}


def declare_anything(folder, world, margin="1000000", *more):
    profile = folder / "profile.toml"
    new = ["profile", "new", "--world", world, "--angle", "0", "--margin", margin, *more]
    assert main([*new, "--out", str(profile)]) == 0
    text = profile.read_text()
    # The seeds of drivers that draw depend on the declaration, so on its date too.
    text = re.sub(r"(?m)^date = .*$", "date = 2026-11-29", text)
    for usual, wide in OPEN.items():
        assert usual in text
        text = text.replace(usual, wide)
    profile.write_text(text)
    return profile


def audit(policy, profile, out):
    words = ["audit", policy, "--profile", str(profile), "--out", str(out)]
    status = main([*words, "--episodes", "40", "--seed", "7"])
    return status, json.loads((out / "report.json").read_bytes())


@pytest.mark.parametrize("policy", ["wait", "go", "atlas:set_egoistic"])
def test_a_declaration_that_excludes_no_driver_is_not_passed(tmp_path, capsys, policy):
    profile = declare_anything(tmp_path, "intersection")
    status, report = audit(policy, profile, tmp_path / "audit")
    assert (status, report["verdict"]["decision"]) == (3, "inconclusive")
    assert "excludes nothing" in report["verdict"]["reason"]
    assert "excludes nothing" in capsys.readouterr().out


def test_one_trivial_driver_that_passes_withholds_the_words(tmp_path):
    """Margin 7 and an open floor: `go` passes, `wait` does not."""
    profile = declare_anything(tmp_path, "intersection", "7", "--largest-loss", "48.07")
    status, report = audit("atlas:set_egoistic", profile, tmp_path / "audit")
    found = report["discrimination"]
    others = {one["name"]: one["decision"] for one in found["drivers"]}
    assert {"go", "wait", "trivial_random"} <= others.keys()
    assert found["would_pass"] == sum(one == "pass" for one in others.values()) > 0
    assert found["of"] == len(others)
    assert others["wait"] != "pass" and "go" in found["trivial_passes"]
    assert (status, report["verdict"]["decision"]) == (0, "pass")
    (caveat,) = (one["text"] for one in report["caveats"] if one["about"] == "margin")
    assert "a driver that always goes would pass it too" in caveat
    page = (tmp_path / "audit" / "report.html").read_text()
    assert "Behaves as declared" not in page and "Keeps the declared limits" in page
    claim = json.loads((tmp_path / "audit" / "claims.json").read_bytes())[1]
    assert "behaves as declared" in claim["text"] and claim["status"] == "undecided"
