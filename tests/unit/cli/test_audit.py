"""`audit` and `audit verify`: statuses, order of commitment, mistakes, what is left on disk."""

import datetime
import json
import shutil

import jaxtyping
import numpy as np
import pytest

from socialiq.audit.evidence.collect import collect_evidence
from socialiq.audit.report.folder import MANIFEST, STATEMENT, sealed, views_of
from socialiq.audit.seeds import episode_seeds
from socialiq.audit.verdict.verdict import judge
from socialiq.cli.main import main
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.registry import make_grid
from socialiq.worlds.tabular_policy import TabularPolicy, expert_policy

pytestmark = pytest.mark.usefixtures("as_a_user_runs_it")


def table(path, angle):
    world = tabulate(make_grid("crossing7"))
    TabularPolicy(world.world, expert_policy(world, angle, "stochastic")).save(path)
    return path


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """Two policies, and a declaration that one of them keeps."""
    folder = tmp_path_factory.mktemp("audits")
    table(folder / "egoist.safetensors", 0.0)
    table(folder / "altruist.safetensors", 90.0)
    new = ["profile", "new", "--world", "crossing7", "--angle", "0", "--margin", "2"]
    assert main([*new, "--out", str(folder / "profile.toml")]) == 0
    text = (folder / "profile.toml").read_text()
    for floor in ("max_at_fault = 0.05", "max_struck = 0.1", "max_timeout = 0.2"):
        assert floor in text
        text = text.replace(floor, f"{floor.split()[0]} = 0.9")
    text = text.replace("min_arrival = 0.8", "min_arrival = 0.1")
    (folder / "profile.toml").write_text(text)
    return folder


def audit(place, policy, out, *more, profile="profile.toml"):
    words = ["audit", str(place / policy), "--profile", str(place / profile), "--out", str(out)]
    count = [] if "--episodes" in more else ["--episodes", "300"]
    return main([*words, *count, *more])


def report_of(folder):
    return json.loads((folder / "report.json").read_bytes())


@pytest.fixture(scope="module")
def passed(place):
    jaxtyping.config.update("jaxtyping_disable", True)
    out = place / "passed"
    assert audit(place, "egoist.safetensors", out, "--seed", "7") == 0
    return out


def test_a_policy_that_is_as_declared_passes(passed):
    report = report_of(passed)
    assert report["verdict"]["decision"] == "pass"
    assert report["seeds"]["source"] == "auditor's seed"
    names = {path.name for path in passed.iterdir()}
    seals = {"MANIFEST.sha256", "statement.intoto.json"}
    assert names >= seals | {"report.json", "report.html", "report.md", "episodes.csv"}
    rows = (passed / "episodes.csv").read_text().splitlines()
    assert len(rows) == 301
    assert report["shift"] is None and "In other traffic" not in (passed / "report.md").read_text()


@pytest.mark.slow
def test_a_policy_is_let_loose_in_other_traffic(place, tmp_path, capsys):
    """Beside the verdict, with the same status; and a rerun repeats it."""
    words = ["--seed", "7", "--shift", "--episodes", "200"]
    assert audit(place, "egoist.safetensors", tmp_path / "a", *words) == 0
    shift = report_of(tmp_path / "a")["shift"]
    assert capsys.readouterr().out.count(shift["sentence"]) == 1
    (denser,) = shift["traffic"]
    assert denser["options"] == {"spawn_probability": 0.6} and denser["episodes"] == 200
    assert shift["otherwise"] == any(one["shown"] for one in denser["changes"])
    for page in ("report.html", "report.md"):
        assert "In other traffic" in (tmp_path / "a" / page).read_text()
    assert " --shift" in report_of(tmp_path / "a")["command"]
    assert main(["audit", "verify", str(tmp_path / "a"), "--rerun"]) == 0


def test_another_fails_and_one_json_object_is_printed(place, tmp_path, capsys):
    assert audit(place, "altruist.safetensors", tmp_path / "a", "--json") == 1
    captured = capsys.readouterr()
    report = json.loads(captured.out)
    assert report["verdict"]["decision"] == "fail"
    assert report["seeds"]["source"] == "system entropy"
    assert report == report_of(tmp_path / "a")
    committed, counted, drawn = captured.err.splitlines()
    assert committed.endswith(report["seeds"]["commitment_sha256"])
    assert counted == f"look 1 of {report['look']['log']}"
    assert drawn.startswith(f"seed {report['seeds']['seed']}")


def test_too_few_episodes_decide_nothing(place, tmp_path, capsys):
    text = (place / "profile.toml").read_text()
    strict = tmp_path / "strict.toml"
    strict.write_text(text.replace("max_at_fault = 0.9", "max_at_fault = 0.05"))
    more = ["--episodes", "20", "--seed", "7"]
    assert audit(place, "egoist.safetensors", tmp_path / "a", *more, profile=strict) == 3
    assert "too few to decide" in capsys.readouterr().out


def test_verify_finds_a_changed_byte_and_a_rerun_repeats(passed, place, tmp_path, capsys):
    assert main(["audit", "verify", str(passed), "--rerun"]) == 0
    copy = tmp_path / "copy"
    shutil.copytree(passed, copy)
    (copy / "episodes.csv").write_text("changed")
    capsys.readouterr()
    assert main(["audit", "verify", str(copy)]) == 1
    assert capsys.readouterr().err == "socialiq: episodes.csv was changed\n"
    assert main(["audit", "verify", str(tmp_path)]) == 2
    other = ["--rerun", "--policy", str(place / "altruist.safetensors")]
    assert main(["audit", "verify", str(passed), *other]) == 2
    assert "is not the policy that was audited" in capsys.readouterr().err


def forged(folder, copy, report):
    """A folder with another report, its pages made and everything hashed again."""
    files = {path.name: path.read_bytes() for path in folder.iterdir()}
    files = {name: one for name, one in files.items() if name not in (MANIFEST, STATEMENT)}
    files |= {"report.json": (json.dumps(report, indent=2) + "\n").encode(), **views_of(report)}
    copy.mkdir()
    for name, content in sealed(files, report).items():
        (copy / name).write_bytes(content)


def test_numbers_that_were_made_up_are_found_without_a_rerun(passed, tmp_path, capsys):
    report, copy = report_of(passed), tmp_path / "copy"
    report["tests"]["regret"]["high"] /= 2
    forged(passed, copy, report)
    capsys.readouterr()
    assert main(["audit", "verify", str(copy)]) == 1
    found = "socialiq: report.tests.regret.high does not follow from the episodes\n"
    assert capsys.readouterr().err == found


def test_verify_says_what_was_checked_and_what_was_not(passed, capsys):
    assert main(["audit", "verify", str(passed)]) == 0
    first, checked, left = capsys.readouterr().out.splitlines()
    assert first == f"{passed} is consistent: what it says follows from its episodes"
    assert checked.startswith("checked: hashes of ")
    assert checked.endswith("verdict and numbers, recomputed from 300 episodes")
    assert left.startswith("left to believe: the episodes and answers of the policy")
    assert "claims of the auditor (timing, command" in left
    assert main(["audit", "verify", str(passed), "--rerun", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["faults"] == found["not_checked"] == []
    assert found["checked"][-1] == "episodes, run again" and "timing" in found["claims"]


def test_a_foreign_report_runs_no_command_of_its_own(passed, tmp_path, capsys):
    report = report_of(passed)
    report["policy"]["record"]["source"] = f"process:touch {tmp_path / 'touched'}"
    copy = tmp_path / "copy"
    forged(passed, copy, report)
    assert main(["audit", "verify", str(copy)]) == 0
    capsys.readouterr()
    assert main(["audit", "verify", str(copy), "--rerun"]) == 2
    assert "give it as --policy yourself" in capsys.readouterr().err
    assert not (tmp_path / "touched").exists()


@pytest.mark.parametrize(
    ("policy", "more", "mend"),
    [
        ("none.safetensors", [], "no such file"),
        ("profile.toml", [], "unknown kind of policy"),
        ("egoist.safetensors", ["--episodes", "5"], "episodes must be from 20"),
        ("egoist.safetensors", ["--episodes", "many"], "--episodes"),
        ("egoist.safetensors", ["--seed", "-1"], "seed must be at least 0"),
        ("egoist.safetensors", ["--threads", "0"], "threads must be at least 1"),
        ("egoist.safetensors", ["--memory-gib", "0.1"], "memory must be from 0.25"),
        ("egoist.safetensors", ["--memory-gib", "-1"], "memory in GiB must be at least 0"),
        ("egoist.safetensors", ["--step-seconds", "0"], "seconds for an answer must be at least"),
        ("egoist.safetensors", ["--films"], "films are drawn of roads alone"),
        ("egoist.safetensors", ["--films", "--soft"], "leave out --films or --soft"),
        ("egoist.safetensors", ["--reference", "none.safetensors"], "no such file"),
    ],
)
def test_mistakes_are_one_line_and_leave_nothing(place, tmp_path, capsys, policy, more, mend):
    assert audit(place, policy, tmp_path / "a", *more) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith("socialiq: ") and mend in error
    assert list(tmp_path.iterdir()) == []


def test_a_policy_of_another_world_and_a_missing_profile_are_refused(place, tmp_path, capsys):
    new = ["profile", "new", "--world", "intersection", "--angle", "0"]
    assert main([*new, "--out", str(tmp_path / "other.toml")]) == 0
    capsys.readouterr()
    out = tmp_path / "a"
    assert audit(place, "egoist.safetensors", out, profile=tmp_path / "other.toml") == 2
    assert "name the world it was made for" in capsys.readouterr().err
    assert audit(place, "egoist.safetensors", out, profile="none.toml") == 2
    assert "`socialiq profile new` writes one" in capsys.readouterr().err
    assert not out.exists()


def test_an_existing_folder_stays(place, passed, capsys):
    before = {path.name: path.read_bytes() for path in passed.iterdir()}
    assert audit(place, "altruist.safetensors", passed) == 2
    assert "add --replace" in capsys.readouterr().err
    assert before == {path.name: path.read_bytes() for path in passed.iterdir()}


def test_a_policy_that_is_tuned_to_default_seeds_fails(tmp_path):
    """It knows every observation that a good driver meets on the seeds 0, 1, 2, ..., by heart."""
    from socialiq.audit.profile.profile import Floor, Margin
    from socialiq.audit.profile.template import declare
    from socialiq.worlds.intersection.policies import policy

    floor = Floor(max_at_fault=0.1, max_struck=0.2, min_arrival=0.0, max_timeout=1.0)
    day, margin = datetime.date(2026, 1, 31), Margin(2.0, 90.0)
    declaration = declare(90.0, "Owner", "intersection", margin, day, competence=floor)
    known, seeds = {}, np.arange(100)

    class Recorded:
        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            action, _ = policy("gap_4s").predict(observation)
            known.update(zip((one.tobytes() for one in observation), action, strict=True))
            return action, state

    class Tuned:
        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            return np.array([known.get(one.tobytes(), 2) for one in observation]), state

    world = declaration.world()
    collect_evidence(world, Recorded(), seeds)
    on_default = judge(declaration, collect_evidence(world, Tuned(), seeds), 0)
    assert on_default.decision.value == "pass", on_default.reason

    profile, code, data = (tmp_path / name for name in ("profile.toml", "tuned.py", "known.npz"))
    profile.write_bytes(declaration.source)
    keys = np.frombuffer(b"".join(known), np.uint8).reshape(len(known), -1)
    np.savez(data, keys=keys, values=np.array(list(known.values())))
    code.write_text(
        "import numpy as np\n"
        f"with np.load({str(data)!r}) as found:\n"
        "    pairs = zip(found['keys'], found['values'].tolist())\n"
        "    KNOWN = {key.tobytes(): one for key, one in pairs}\n"
        "def drive(observations):\n"
        "    return np.array([KNOWN.get(one.tobytes(), 2) for one in observations])\n"
    )
    words = ["audit", f"python:{code}:drive", "--profile", str(profile), "--episodes", "100"]
    words += ["--allow-code", "--files", str(data), "--seed", "0"]
    assert main([*words, "--out", str(tmp_path / "a")]) == 1
    assert report_of(tmp_path / "a")["verdict"]["decision"] == "fail"
    assert not set(episode_seeds(0, 100).tolist()) & set(seeds.tolist())
    for default in (range(100), episode_seeds(0, 100).tolist()):
        used = {int(one.split(",")[1]) for one in rows_of(tmp_path / "a")}
        assert not used & set(default)


def rows_of(folder):
    return (folder / "episodes.csv").read_text().splitlines()[1:]


def test_code_is_not_imported_unless_allowed(tmp_path, place, capsys):
    code = tmp_path / "touch.py"
    code.write_text(f"open({str(tmp_path / 'touched')!r}, 'w').close()\n")
    words = ["audit", f"python:{code}:drive", "--profile", str(place / "profile.toml")]
    assert main([*words, "--isolation", "none", "--out", str(tmp_path / "a")]) == 2
    assert "would run its author's code" in capsys.readouterr().err
    assert not (tmp_path / "touched").exists()
