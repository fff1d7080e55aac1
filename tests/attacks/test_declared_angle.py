"""Attack: a policy is declared at an angle that it doesn't drive.

It worked: with the default declaration the egoist passed at 45 degrees, and the dial of 45 at 0 and
at 75, because regret hardly depends on the angle.
"""

import json

import pytest

from socialiq.audit.request import SHIPPED_DIAL
from socialiq.cli.main import main
from socialiq.nn.dial_policy import DialPolicy
from socialiq.storage import packaged_results


@pytest.fixture
def audit(tmp_path):
    def audited(policy, angle, episodes):
        profile, out = tmp_path / "profile.toml", tmp_path / "audit"
        new = ["profile", "new", "--world", "intersection", "--angle", str(angle)]
        assert main([*new, "--out", str(profile)]) == 0
        words = ["audit", str(policy), "--profile", str(profile), "--out", str(out)]
        status = main([*words, "--episodes", str(episodes), "--seed", "7"])
        return status, json.loads((out / "report.json").read_bytes())

    return audited


def turned(folder, angle):
    path = folder / "policy.safetensors"
    DialPolicy.load(packaged_results() / SHIPPED_DIAL).at(angle).save(path)
    return path


@pytest.mark.slow
def test_the_egoist_does_not_pass_at_45_degrees(audit, capsys):
    status, report = audit("atlas:iterated_egoistic", 45, 400)
    direction = report["tests"]["direction"]
    assert (status, direction["decision"]) == (1, "fail")
    assert direction["above"] is None and direction["below"] <= 30.0
    assert "its direction is beyond the declared width" in report["verdict"]["reason"]
    assert "Angles not excluded: below" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize("declared", [0, 75])
def test_the_dial_of_45_degrees_fails_elsewhere(audit, tmp_path, declared):
    status, report = audit(turned(tmp_path, 45.0), declared, 1500)
    assert (status, report["tests"]["direction"]["decision"]) == (1, "fail")
