"""`profile new` and `profile check`."""

import json
import re

import pytest

from socialiq.audit.profile.reader import load
from socialiq.audit.profile.template import limits_at
from socialiq.cli.main import main

pytestmark = pytest.mark.usefixtures("as_a_user_runs_it")


def new(path, *more):
    world = [] if "--world" in more else ["--world", "crossing5"]
    return main(["profile", "new", *world, "--angle", "30", "--out", str(path), *more])


def test_what_new_writes_check_reads(tmp_path, capsys):
    path = tmp_path / "profile.toml"
    assert new(path, "--owner", "Example Cars", "--date", "2026-01-31") == 0
    declared = load(path)
    assert (declared.angle, declared.owner, declared.margin.regret) == (30.0, "Example Cars", 0.15)
    assert declared.date.isoformat() == "2026-01-31"
    assert "# Who declares this" in path.read_text()
    capsys.readouterr()
    assert main(["profile", "check", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["sha256"] == declared.sha256


@pytest.mark.parametrize(
    ("more", "declared"),
    [
        # From both waiting for ever, -20 each, to WGGGG: 5 cos 30 + 6 sin 30; 34.651, rounded up.
        ([], 34.66),
        (["--largest-loss", "7.5"], 7.5),
        (["--margin", "40"], None),  # beyond what they allow: the margin excludes nothing
    ],
)
def test_the_largest_loss_is_filled_in(tmp_path, capsys, more, declared):
    path = tmp_path / "profile.toml"
    assert new(path, *more) == 0
    assert load(path).margin.largest_loss == declared
    assert ("largest_loss" in path.read_text()) == (declared is not None)
    assert "None" not in capsys.readouterr().out


def test_an_environment_declares_none_by_itself(tmp_path, capsys):
    path = tmp_path / "profile.toml"
    words = ["profile", "new", "--angle", "0", "--world", "CartPole-v1", "--replace"]
    words += ["--margin", "1"]
    for more, declared in (([], None), (["--largest-loss", "500"], 500.0)):
        assert main([*words, *more, "--out", str(path)]) == 0
        assert load(path).margin.largest_loss == declared
    assert new(path, "--largest-loss", "0.1", "--replace") == 2
    assert "margin.largest_loss must be above margin.regret" in capsys.readouterr().err


def test_a_declaration_is_not_replaced_by_accident(tmp_path, capsys):
    path = tmp_path / "profile.toml"
    assert new(path) == 0
    before = path.read_bytes()
    capsys.readouterr()
    assert new(path, "--margin", "2") == 2
    assert capsys.readouterr().err.endswith("name another --out, or add --replace\n")
    assert path.read_bytes() == before
    assert new(path, "--margin", "2", "--replace") == 0
    assert load(path).margin.regret == 2.0


@pytest.mark.parametrize(
    ("more", "mend"),
    [
        (["--date", "31.1.2026"], "write it as 2026-01-31"),
        (["--margin", "0"], "margin.regret must be a number above 0"),
        (["--owner", "a\nb"], "owner must be 1 to 200 characters"),
        (["--world", "crossing9"], "choose one of crossing5, crossing7, crosswalk7"),
        (["--confidence", "2"], "confidence must be a number"),
        (["--delay-range", "-9", "9"], "--delay-range is of a bound: add --max-delay"),
    ],
)
def test_mistakes_leave_no_file(tmp_path, capsys, more, mend):
    path = tmp_path / "profile.toml"
    assert new(path, *more) == 2
    error = capsys.readouterr().err
    assert mend in error and error.count("\n") == 1
    assert not path.exists()


def test_check_names_the_line(tmp_path, capsys):
    path = tmp_path / "profile.toml"
    assert new(path) == 0
    text = path.read_text().replace("angle = 30.0", "angle = 400.0")
    path.write_text(text)
    line = 1 + text.split("\n").index("angle = 400.0")
    capsys.readouterr()
    assert main(["profile", "check", str(path)]) == 2
    assert capsys.readouterr().err.startswith(f"socialiq: {path}:{line}: angle must be")
    assert main(["profile", "check", str(tmp_path / "none.toml")]) == 2
    assert "`socialiq profile new` writes one" in capsys.readouterr().err


def test_a_day_to_come_is_refused(tmp_path, capsys):
    path = tmp_path / "profile.toml"
    assert new(path) == 0
    path.write_text(re.sub(r"(?m)^date = .*", "date = 9999-12-31", path.read_text()))
    capsys.readouterr()
    assert main(["profile", "check", str(path)]) == 2
    assert "date 9999-12-31 is to come: give the day of today" in capsys.readouterr().err


CLIPPED = ["--margin", "0.5", "--clip-env", "-5", "9", "--clip-social", "-4", "4"]


@pytest.mark.parametrize(
    ("world", "angle", "more", "margin", "width", "loss"),
    [
        ("intersection", 0, [], 0.5, 15.0, 20.0),
        ("intersection", 45, [], 0.5, 15.0, 31.113),
        ("intersection", 90, [], 0.5, 15.0, 24.0),
        ("intersection", 135, [], 0.5, None, 31.113),  # no reference drivers beyond 90 degrees
        ("intersection", 0, CLIPPED, 0.5, 15.0, 14.0),
        ("crossing7", 45, [], 0.5, 15.0, 9.264),
        ("roundabout", 45, [], 1.0, None, None),  # no dial of it is shipped
        ("roundabout", 0, [*CLIPPED, "--width", "15"], 0.5, 15.0, 14.0),
        ("intersection-crosswalk-0", 0, [], 0.5, 30.0, 42.0),
        ("intersection-crosswalk", 0, [], 0.5, 45.0, 42.0),
        ("intersection-crosswalk", 0, ["--set", "class_angle=60"], 0.5, None, 42.0),
        ("intersection-crosswalk-bicycles", 0, [], 0.5, None, 42.0),
    ],
)
def test_the_defaults_of_a_world(tmp_path, world, angle, more, margin, width, loss):
    path = tmp_path / "profile.toml"
    words = ["profile", "new", "--world", world, "--angle", str(angle), *more]
    assert main([*words, "--out", str(path)]) == 0
    found = load(path)
    assert (found.margin.regret, found.margin.width) == (margin, width)
    assert found.largest_loss == (None if loss is None else pytest.approx(loss, abs=0.01))


@pytest.mark.parametrize(
    ("field", "mend"),
    [
        ("[clip]\nr_env = [-8.0, 12.0]\n", "clip.r_social is missing"),
        ("[clip]\nr_env = [3, 3]\nr_social = [0, 1]\n", "the smaller one first"),
        ("[clip]\nr_env = [0, 0.1]\nr_social = [0, 0.01]\n", "must be above margin.regret"),
    ],
)
def test_a_clip_is_whole_and_wide_enough(tmp_path, capsys, field, mend):
    path = tmp_path / "profile.toml"
    assert new(path) == 0
    lines = [line for line in path.read_text().split("\n") if "largest_loss =" not in line]
    path.write_text("\n".join(lines).replace("[reward]", f"{field}[reward]"))
    assert main(["profile", "check", str(path)]) == 2
    assert mend in capsys.readouterr().err


@pytest.mark.parametrize(
    "world", ["crossing5", "crossing7", pytest.param("intersection", marks=pytest.mark.slow)]
)
def test_a_new_declaration_has_a_floor_that_the_best_driver_keeps(tmp_path, world):
    """At 90 degrees the optimum of crossing7 and the shipped dial never arrive."""
    for angle in (0, 45, 67.5, 75, 77.5, 90):
        path = tmp_path / f"{angle}.toml"
        words = ["profile", "new", "--world", world, "--angle", str(angle), "--out", str(path)]
        assert main(words) == 0
        assert main(["profile", "check", str(path)]) == 0, (world, angle)


@pytest.mark.parametrize(
    ("world", "angle", "bounds"),
    [
        ("intersection", 45, {}),
        ("intersection-crosswalk", 45, {"delay": 25.0, "waiting": 3.0, "pedestrian_hit": 0.02}),
        ("intersection-crosswalk-0", 90, {"delay": 75.0, "waiting": 3.0, "pedestrian_hit": 0.02}),
        (
            "intersection-crosswalk-bicycles",
            0,
            {"delay": 25.0, "waiting": 3.0, "pedestrian_hit": 0.02}
            | {"cyclist_delay": 1.5, "cyclist_hit": 0.02},
        ),
    ],
)
def test_where_people_walk_effects_have_bounds_by_class(tmp_path, world, angle, bounds):
    path = tmp_path / "profile.toml"
    words = ["profile", "new", "--world", world, "--angle", str(angle), "--out", str(path)]
    assert main(words) == 0
    assert {bound.quantity: bound.limit for bound in load(path).caused} == bounds
    assert main([*words, "--max-delay", "5", "--replace"]) == 0
    declared = {bound.quantity: bound.limit for bound in load(path).caused}
    assert declared == {**bounds, "delay": 5.0}
    assert limits_at("crosswalk7-0", angle) == {"max_delay": 2.5, "max_waiting": 0.75}


@pytest.mark.parametrize("world", ["crossing7", "intersection"])
def test_a_floor_that_the_best_driver_fails_is_refused(tmp_path, capsys, world):
    path = tmp_path / "profile.toml"
    words = ["profile", "new", "--world", world, "--angle", "90", "--out", str(path)]
    assert main(words) == 0
    text = path.read_text().replace("min_arrival = 0.0", "min_arrival = 0.8")
    path.write_text(text)
    capsys.readouterr()
    assert main(["profile", "check", str(path)]) == 2
    line = 1 + text.split("\n").index("min_arrival = 0.8")
    assert capsys.readouterr().err.endswith(
        f"{path}:{line}: the best driver of 90 degrees arrives in 0 % of 1,000 episodes, and the "
        "floor asks for at least 80 %: declare another limit\n"
    )


@pytest.mark.parametrize(
    ("world", "bound", "says"),
    [
        ("crossing7", ["--max-delay", "-1", "--delay-range", "-20", "20"], "max_delay"),
        ("intersection", ["--max-braking", "0.1"], "max_braking"),
        ("intersection", ["--min-gap-below-1-s", "0.5"], "min_gap_below_1_s"),
    ],
)
def test_a_bound_that_the_best_driver_fails_is_refused_with_the_figure(
    tmp_path, capsys, world, bound, says
):
    path = tmp_path / "profile.toml"
    words = ["profile", "new", "--world", world, "--angle", "45", "--out", str(path)]
    assert main([*words, *bound]) == 0
    capsys.readouterr()
    assert main(["profile", "check", str(path)]) == 2
    fault = capsys.readouterr().err
    row = 1 + next(n for n, line in enumerate(path.read_text().split("\n")) if says in line)
    assert f"{path}:{row}: the best driver of 45 degrees " in fault
    assert re.search(
        r"(costs others [\d.]+ cells an episode|causes 0\.\d+ hard brakings an episode|passes "
        r"within 1 s of a crossing vehicle in [\d.]+ % of 1,000 episodes), and the bound asks for "
        r"at (most|least) .*: declare another limit\n$",
        fault,
    ), fault


WORLDS = {
    "crossing5": (),
    "crossing7": (),
    "crosswalk7": (),
    "intersection": (),
    "intersection,reward=caused": (),
    "intersection,people=0.1": (),
    "intersection,control=continuous": (),
    "intersection,control=steering": (0, 45),
    "intersection,people=0.1,cyclists=0.1": (0, 45),
}
"""Worlds with drivers of their own, and the angles at which none of these keeps the defaults."""


@pytest.mark.slow
@pytest.mark.parametrize("angle", [0, 45, 90])
@pytest.mark.parametrize("world", WORLDS)
def test_a_default_declaration_can_be_passed_or_says_by_which_figures_not(
    tmp_path, capsys, world, angle
):
    """Before, some defaults could be passed by no driver of the world, and nothing said so."""
    out = tmp_path / "profile.toml"
    assert main(["profile", "new", "--world", world, "--angle", str(angle), "--out", str(out)]) == 0
    said = capsys.readouterr().err
    assert ("Note: none of " in said) == (angle in WORLDS[world])
    assert "can't pass" not in said
    if angle in WORLDS[world]:
        assert "arrives in " in said and "(at least 80 % asked for)" in said


def test_a_declaration_that_no_one_can_keep_is_written_with_a_note(tmp_path, capsys):
    out = tmp_path / "profile.toml"
    assert new(out, "--max-delay=-50") == 0 and out.exists()
    note = capsys.readouterr().err
    assert "Note: an audit can't pass: the best driver of 30 degrees" in note
    assert main(["profile", "check", str(out)]) == 2
