"""Attack: limits of rewards and effects, or a width, with which the tests see nothing.

A range that ends above the limit cuts what the driver costs others, a clip makes all drivers alike,
and a width without an end from 0 to 90 degrees holds every direction.
"""

import json
import re

import pytest

from socialiq.cli.main import main


def declare(place, out, *options):
    """Write a declaration with the open floor of the owner's own one; return its path."""
    path = out / "profile.toml"
    words = ["profile", "new", "--world", "crossing7", *options, "--out", str(path)]
    assert main(words) == 0
    text = path.read_text()
    own = (place / "profile.toml").read_text()
    for name in ("max_at_fault", "max_struck", "min_arrival", "max_timeout"):
        line = re.search(f"^{name} = .*$", own, re.MULTILINE)
        text = re.sub(f"(?m)^{name} = .*$", line[0], text)
    path.write_text(text)
    return path


def audited(place, out, policy, profile):
    words = [
        "audit",
        str(place / f"{policy}.safetensors"),
        "--profile",
        str(profile),
        "--seed",
        "7",
    ]
    main([*words, "--episodes", "200", "--out", str(out / "audit")])
    return json.loads((out / "audit" / "report.json").read_text())["verdict"]


LIMITS = (
    ("--max-delay", "0.5", "--delay-range", "-100", "0.6"),
    ("--clip-env", "-0.1", "0.6", "--clip-social", "-0.1", "0.6"),
)


@pytest.mark.parametrize("options", LIMITS)
def test_limits_that_cut_usual_episodes_withhold_the_pass(place, tmp_path, options):
    profile = declare(place, tmp_path, "--angle", "0", "--margin", "0.5", *options)
    verdict = audited(place, tmp_path, "egoist", profile)
    assert verdict["decision"] == "inconclusive"
    assert "Declare wider limits" in verdict["reason"]


@pytest.mark.parametrize("options", LIMITS)
def test_limits_that_cut_the_best_driver_are_refused(place, tmp_path, options, capsys):
    profile = declare(place, tmp_path, "--angle", "0", "--margin", "0.5", *options)
    assert main(["profile", "check", str(profile)]) == 2
    assert "episodes of the best driver" in capsys.readouterr().err


def test_a_width_without_an_end_decides_nothing(place, tmp_path, capsys):
    options = ("--angle", "45", "--width", "60", "--margin", "20", "--largest-loss", "30")
    profile = declare(place, tmp_path, *options)
    assert main(["profile", "check", str(profile)]) == 2
    assert "no end from 0 to 90 degrees" in capsys.readouterr().err
    verdict = audited(place, tmp_path, "egoist", profile)
    assert verdict["decision"] == "inconclusive"
    assert "no end of the width from 0 to 90 degrees" in verdict["reason"]
