"""An audit in parts: the same evidence, to the last bit, in however many parts."""

import dataclasses
import json

import numpy as np
import pytest

from socialiq.audit.conduct import conduct
from socialiq.audit.request import Request
from socialiq.cli.main import main
from socialiq.errors import UserError


def silent(_):
    return None


def declare(folder, world):
    path = folder / "profile.toml"
    words = ["profile", "new", "--world", world, "--angle", "0", "--margin", "20"]
    assert main([*words, "--out", str(path)]) == 0
    return path


def assert_equal(ours, theirs):
    assert (ours.scenario, ours.strata.keys()) == (theirs.scenario, theirs.strata.keys())
    np.testing.assert_array_equal(ours.seeds, theirs.seeds)
    for name, labels in theirs.strata.items():
        np.testing.assert_array_equal(ours.strata[name], labels)
    pairs = zip((ours.policy, *ours.references), (theirs.policy, *theirs.references), strict=True)
    for one, other in pairs:
        np.testing.assert_equal(dataclasses.asdict(one), dataclasses.asdict(other))


def same(report):
    """Return what a report says, without when and how long."""
    return {
        key: value for key, value in report.items() if key in ("verdict", "tests", "data", "shift")
    }


@pytest.mark.slow
@pytest.mark.parametrize(
    ("world", "policy"),
    [
        ("crossing7", "examples"),
        ("intersection", "atlas:prosocial"),
    ],
)
def test_parts_are_the_whole(tmp_path, trained, world, policy):
    policy = str(trained) if world == "crossing7" else policy
    request = Request(policy, declare(tmp_path, world), 41, seed=5)
    whole = conduct(request, silent)
    for processes in (1, 2):
        found = conduct(request, silent, processes=processes)
        for ours, theirs in zip(found.audited.evidence, whole.audited.evidence, strict=True):
            assert_equal(ours, theirs)
        assert json.dumps(same(found.report)) == json.dumps(same(whole.report))


@pytest.fixture(name="trained", scope="module")
def small_network(tmp_path_factory):
    folder = tmp_path_factory.mktemp("trained")
    data = folder / "mixed.safetensors"
    assert main(["collect", "crossing7", "--episodes", "2", "--out", str(data)]) == 0
    words = [
        "train",
        "iq-learn",
        str(data),
        "--world",
        "crossing7",
        "--updates",
        "5",
        "--hidden",
        "8",
    ]
    assert main([*words, "--out", str(folder / "run")]) == 0
    return folder / "run" / "policy_angle0.safetensors"


@pytest.mark.slow
def test_an_audit_in_parts_by_command(tmp_path, trained, capsys):
    profile = declare(tmp_path, "crossing7")
    words = ["audit", str(trained), "--profile", str(profile), "--episodes", "30", "--seed", "3"]
    words += ["--json", "--no-log"]
    capsys.readouterr()
    alone = main([*words, "--out", str(tmp_path / "alone")])
    whole = json.loads(capsys.readouterr().out)
    assert main([*words, "--out", str(tmp_path / "parts"), "--processes", "2"]) == alone
    assert same(json.loads(capsys.readouterr().out)) == same(whole)


def test_what_can_not_be_split_is_refused(tmp_path, trained, capsys):
    request = Request(str(trained), declare(tmp_path, "crossing7"), 20, seed=1, soft=True)
    with pytest.raises(UserError, match="draws its actions in order: leave out --soft"):
        conduct(request, silent, processes=2)
    words = ["audit", str(trained), "--profile", str(tmp_path / "profile.toml")]
    words += ["--out", str(tmp_path / "out")]
    assert main([*words, "--soft", "--processes", "2"]) == 2
    assert "leave out --soft" in capsys.readouterr().err
    assert not (tmp_path / "audit-log").exists()  # it was no look
    assert main([*words, "--processes", "-1"]) == 2
    assert "processes must be at least 1" in capsys.readouterr().err
