"""`audit across`: one verdict over audits of one policy in several scenarios."""

import json
import re
import shutil

import pytest

from socialiq.cli.main import main
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.registry import make_grid
from socialiq.worlds.tabular_policy import TabularPolicy, expert_policy

pytestmark = pytest.mark.usefixtures("as_a_user_runs_it")


@pytest.fixture(scope="module")
def audits(tmp_path_factory):
    """Audits of two policies at 0 degrees in two scenarios, and of one at 90 degrees."""
    place = tmp_path_factory.mktemp("across")
    world = tabulate(make_grid("crossing5"))
    for name, angle in (("egoist", 0.0), ("altruist", 90.0)):
        path = place / f"{name}.safetensors"
        TabularPolicy(world.world, expert_policy(world, angle, "stochastic")).save(path)
    for scenario, angle, ends in (
        ("usual", 0, "ego_arrival"),
        ("longer", 0, "both_arrived"),
        ("other", 90, "ego_arrival"),
    ):
        new = ["profile", "new", "--world", "crossing5", "--angle", str(angle), "--margin", "2"]
        path = place / f"{scenario}.toml"
        assert main([*new, "--set", f"ends_on={ends}", "--out", str(path)]) == 0
        floor = path.read_text().replace("max_at_fault = 0.05", "max_at_fault = 0.9")
        floor = floor.replace("max_struck = 0.1", "max_struck = 0.9")
        path.write_text(floor.replace("min_arrival = 0.8", "min_arrival = 0.1"))
    longer = (place / "longer.toml").read_text()
    for name, old, new in (
        ("owner", 'owner = "unnamed owner"', 'owner = "another owner"'),
        ("margin", "regret = 2.0", "regret = 3.0"),
        ("floor", "max_struck = 0.9", "max_struck = 0.8"),
    ):
        assert old in longer
        (place / f"{name}.toml").write_text(longer.replace(old, new))
    bounds = ["--max-delay", "50", "--set", "ends_on=both_arrived", "--margin", "2"]
    words = ["profile", "new", "--world", "crossing5", "--angle", "0", *bounds, "--replace"]
    assert main([*words, "--out", str(place / "bounds.toml")]) == 0
    text = (place / "bounds.toml").read_text()
    for line in longer.splitlines():
        if line.startswith(("max_at_fault", "max_struck", "min_arrival")):
            text = re.sub(f"(?m)^{line.split()[0]} = .*$", line, text)
    (place / "bounds.toml").write_text(text)
    others = [("egoist", name) for name in ("owner", "margin", "floor", "bounds")]
    for policy, scenario in (
        ("egoist", "usual"),
        ("egoist", "longer"),
        ("altruist", "longer"),
        ("egoist", "other"),
        *others,
    ):
        words = ["audit", str(place / f"{policy}.safetensors"), "--episodes", "120", "--seed", "7"]
        profile, out = str(place / f"{scenario}.toml"), str(place / f"{policy}-{scenario}")
        assert main([*words, "--profile", profile, "--out", out]) in (0, 1, 3)
    return place


def across(audits, *names, more=()):
    return main(["audit", "across", *(str(audits / name) for name in names), *more])


def verdict_of(folder):
    return json.loads((folder / "report.json").read_bytes())["verdict"]["decision"]


def test_passes_everywhere_pass(audits, capsys):
    assert {verdict_of(audits / f"egoist-{name}") for name in ("usual", "longer")} == {"pass"}
    assert across(audits, "egoist-usual", "egoist-longer") == 0
    out = capsys.readouterr().out
    assert "crossing5 ends_on both_arrived" in out
    assert "PASS across 2 scenarios" in out and "at most 5 %" in out
    assert "Without a log" in out
    notes = [line for line in out.splitlines() if line.startswith("Note (")]
    assert any("No audit log was kept" in line and "egoist-longer" in line for line in notes)


def test_one_failure_fails_and_json_has_each_scenario(audits, tmp_path, capsys):
    policy = audits / "altruist.safetensors"
    words = ["audit", str(policy), "--profile", str(audits / "usual.toml"), "--episodes", "120"]
    assert main([*words, "--out", str(tmp_path / "logged")]) == 1
    capsys.readouterr()
    folders = [str(tmp_path / "logged"), str(audits / "altruist-longer")]
    assert main(["audit", "across", *folders, "--json"]) == 1
    result = json.loads(capsys.readouterr().out)
    assert result["decision"] == "fail"
    assert [row["look"] for row in result["scenarios"]] == [1, ""]
    assert result["without_log"] == folders[1:]


@pytest.mark.parametrize(
    ("names", "says"),
    [
        (["egoist-usual"], "two or more folders"),
        (["egoist-usual", "altruist-longer"], "the same policy"),
        (["egoist-usual", "egoist-other"], "the same declared angle"),
        (["egoist-usual", "egoist-longer", "egoist-usual"], "of one scenario"),
        (["egoist-usual", "nowhere"], "has no report"),
        (["egoist-usual", "egoist-owner"], "the same owner"),
        (["egoist-usual", "egoist-margin"], "the same margins and width"),
        (["egoist-usual", "egoist-floor"], "the same safety floor"),
        (["egoist-usual", "egoist-bounds"], "the same bounds of effects"),
    ],
)
def test_mistakes_are_one_line(audits, names, says, capsys):
    assert across(audits, *names) == 2
    message = capsys.readouterr().err
    assert says in message
    assert len(message.splitlines()) == 1


def test_a_forged_verdict_is_refused(audits, tmp_path, capsys):
    forged = tmp_path / "forged"
    shutil.copytree(audits / "egoist-longer", forged)
    report = json.loads((forged / "report.json").read_bytes())
    report["verdict"]["reason"] = "It drives well."
    (forged / "report.json").write_text(json.dumps(report))
    assert main(["audit", "across", str(audits / "egoist-usual"), str(forged)]) == 2
    assert "report.json was changed" in capsys.readouterr().err


def test_a_scenario_of_unknown_options_is_one_line(tmp_path, capsys):
    words = [
        "profile",
        "new",
        "--world",
        "crossing5",
        "--angle",
        "0",
        "--out",
        f"{tmp_path}/p.toml",
    ]
    for word in ("speed=1", "ends_on", "ends_on=never"):
        assert main([*words, "--set", word]) == 2
        assert len(capsys.readouterr().err.splitlines()) == 1
