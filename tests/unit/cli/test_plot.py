"""`plot`: the thesis' figures of a user's own policies."""

import json
from pathlib import Path

import numpy as np
import pytest

from socialiq.cli.main import main
from socialiq.cli.plot import Ring, Stops
from socialiq.evaluation.exact import Ground, action_table
from socialiq.evaluation.stops import stop_rows, visited
from socialiq.nn.q_policy import QPolicy
from socialiq.plotting import thesis
from socialiq.worlds.tabular_policy import expert_policy


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A sweep of two strengths and two seeds, of which none has turned at 20 updates."""
    folder = tmp_path_factory.mktemp("runs")
    data = str(folder / "mixed.safetensors")
    assert main(["collect", "crossing7", "--episodes", "4", "--out", data]) == 0
    words = ["--world", "crossing7", "--angle", "0", "--seed", "0", "1", "--updates", "20"]
    for name, strengths in (("sweep", ["0", "5"]), ("one", ["2"])):
        out = str(folder / name)
        assert (
            main(["train", "iq-learn", data, *words, "--strength", *strengths, "--out", out]) == 0
        )
    return folder


def files(folder):
    return tuple(sorted(folder.glob("*.safetensors")))


def test_policies_of_one_angle_are_one_mark_with_their_range(runs, tmp_path, capsys):
    (axes,) = Ring(files(runs / "one"), out=tmp_path / "ring.png").figure().axes
    (label,) = axes.get_legend_handles_labels()[1]
    angles = []
    for file in files(runs / "one"):
        assert main(["evaluate", str(file), "--world", "crossing7", "--json"]) == 0
        angles.append(json.loads(capsys.readouterr().out)["angle"])
    assert label.startswith("egoistic: ")
    assert f"({min(angles):.1f}° to {max(angles):.1f}°, 2 policies)" in label


def test_drivers_of_any_world_are_on_the_ring_with_the_interval_of_their_episodes(tmp_path):
    words = (Path("go"), Path("random"))
    (axes,) = Ring(words, out=tmp_path / "r.png", world="merge", episodes=4).figure().axes
    labels = axes.get_legend_handles_labels()[1]
    assert [label.partition(":")[0] for label in labels] == ["go", "random"]
    assert all("° to " in label for label in labels)


def test_maps_show_where_the_policy_stops(runs, tmp_path):
    (file, _) = files(runs / "one")
    picture = Stops((file,), out=tmp_path / "stops.png").figure()
    _, below = (axes.images[0].get_array() for axes in picture.axes if axes.images[:1])
    part = Ground.of("crossing7").part
    rows = stop_rows(part, "it", *visited(part, action_table(QPolicy.load(file), part, "greedy")))
    places = sorted({row["y_1"] for row in rows}), sorted({row["y_2"] for row in rows})
    assert below.shape == tuple(map(len, places))
    for row in rows:
        place = (places[0].index(row["y_1"]), places[1].index(row["y_2"]))
        assert below[place] == pytest.approx(row["unweighted"])


def test_the_altruistic_expert_stops_for_a_vehicle_that_comes():
    ground = Ground.of("crossing7")
    chances = expert_policy(ground.table, 90.0)[ground.table.mdp.reachable()]
    rows = stop_rows(ground.part, "altruist", *visited(ground.part, chances))
    assert all(row["unweighted"] == 1.0 for row in rows if row["y_1"] == 2)


def test_a_policy_of_the_time_has_the_shares_of_its_visits():
    part = Ground.of("crossing7").part
    go, stop = (np.eye(part.mdp.n_actions)[[action] * part.mdp.n_states] for action in (2, 0))
    times = part.world.horizon
    early, _ = visited(part, np.stack([stop] * times))
    assert (early[:, 0] == 1.0).all()
    mixed, visits = visited(part, np.stack([go, *[stop] * (times - 1)]))
    start = part.mdp.initial > 0
    assert (mixed[start, 2] > 0).all()
    assert mixed[visits > 0].sum(axis=1) == pytest.approx(1.0)


def test_a_sweep_marks_runs_that_have_not_settled(runs, tmp_path):
    out = tmp_path / "sweep.png"
    assert main(["plot", "sweep", str(runs / "sweep"), "--out", str(out)]) == 0
    assert out.read_bytes()[:4] == b"\x89PNG"
    rows = [
        {"strength": strength, "seed": 0, "updates": updates, "angle": angle}
        for strength, angles in ((0.0, (150.0, 150.0)), (5.0, (10.0, -40.0)))
        for updates, angle in zip((10, 20), angles, strict=True)
    ]
    _, right = thesis.adaptation(rows, "title", -42.0).axes
    assert [(np.asarray(line.get_ydata()).item(), line.get_marker()) for line in right.lines] == [
        (20, "x"),
        (20, "."),
    ]


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["ring", "no.safetensors", "--out", "a.png"], "no such file: no.safetensors"),
        (["ring", "--out", "a.png"], "no policy: name at least one file"),
        (["ring", "go", "--world", "merge", "--out", "a.png"], "add --episodes N"),
        (["ring", "go", "--out", "a.jpg"], "unknown kind of picture '.jpg'"),
        (
            ["stops", "go", "--world", "crossing5", "--out", "a.png"],
            "crossing5 has no map of stops",
        ),
        (["sweep", "nowhere", "--out", "a.png"], "no such file"),
        (["sweep", "--out", "a.png"], "needs"),
        (["cake", "--out", "a.png"], "unknown command"),
    ],
)
def test_a_mistake_gets_one_line(words, line, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["plot", *words]) == 2
    error = capsys.readouterr().err
    assert line in error
    assert error.count("\n") == 1
    assert not (tmp_path / "a.png").exists()


def test_a_run_without_strengths_or_of_two_targets_is_no_sweep(runs, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    data = str(runs / "mixed.safetensors")
    run = ["train", "iq-learn", data, "--world", "crossing7", "--updates", "2"]
    assert main([*run, "--angle", "0", "45", "--out", "two"]) == 0
    assert main(["train", "cql", data, "--updates", "2", "--out", "cql"]) == 0
    capsys.readouterr()
    for folder, line in (("two", "runs of 2 target angles"), ("cql", "has no greedy_angle")):
        assert main(["plot", "sweep", folder, "--out", "a.png"]) == 2
        assert line in capsys.readouterr().err


def test_metrics_without_a_row_are_no_sweep(tmp_path, capsys):
    (tmp_path / "metrics.csv").write_text("strength,greedy_angle,angle_target\n")
    assert main(["plot", "sweep", str(tmp_path), "--out", str(tmp_path / "a.png")]) == 2
    assert "has no strength" in capsys.readouterr().err and not (tmp_path / "a.png").exists()
