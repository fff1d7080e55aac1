import contextlib
import csv
import dataclasses
import io
import itertools
import json
import math

import jax
import numpy as np
import pytest

from socialiq.cli.commands import COMMANDS, command_class
from socialiq.cli.main import main
from socialiq.demonstrations import files
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.storage import packaged_results
from socialiq.worlds.intersection import atlas

TINY = ["--updates", "20", "--set", "batch_size=8", "--hidden", "8"]


def json_of(capsys, *arguments):
    """Run a command with --json; standard output must be exactly one JSON object."""
    assert main([*arguments, "--json"]) == 0
    out = capsys.readouterr().out
    assert out.count("\n") == 1
    return json.loads(out)


@pytest.fixture(scope="module")
def demonstrations(tmp_path_factory):
    path = tmp_path_factory.mktemp("data") / "mixed.safetensors"
    assert main(["collect", "crossing7", "--episodes", "3", "--out", str(path)]) == 0
    return path


@pytest.fixture(scope="module")
def run(demonstrations, tmp_path_factory):
    out = tmp_path_factory.mktemp("runs") / "run"
    arguments = [
        "train",
        "iq-learn",
        str(demonstrations),
        "--world",
        "crossing7",
        "--angle",
        "0",
        "90",
    ]
    assert main([*arguments, "--seed", "1", "2", "--out", str(out), *TINY]) == 0
    return out


@pytest.mark.parametrize("name", COMMANDS)
def test_each_option_is_an_argument_of_the_command(name):
    """A field that is no argument would be an option that accepts anything."""
    classes = [command_class(name)]
    for kind in classes:
        for field in dataclasses.fields(kind):
            assert field.init, f"{kind.__name__}.{field.name}"
            if dataclasses.is_dataclass(field.default_factory):
                classes.append(field.default_factory)


def test_collect_records_drivers_of_a_road(tmp_path):
    words = ["socialiq/Intersection-v1", "--driver", f"egoist={atlas.path_of('egoistic')}"]
    assert (
        main(["collect", *words, "--episodes", "2", "--out", str(tmp_path / "y.safetensors")]) == 0
    )


def test_solve_gives_the_exact_optimum(capsys):
    found = json_of(capsys, "solve", "crossing7", "--angle", "45")
    assert (found["r_env"], found["r_social"]) == (1.81, 0.32)
    assert found["angle_hat"] == pytest.approx(10.026, abs=1e-3)
    assert (found["states"], found["reachable_states"]) == (12096, 276)


def test_solve_stationary_differs_where_the_clock_matters(capsys):
    with_clock = json_of(capsys, "solve", "crossing7", "--angle", "75")
    without = json_of(capsys, "solve", "crossing7", "--angle", "75", "--stationary")
    assert with_clock["value"] - without["value"] == pytest.approx(0.442, abs=1e-3)


def test_front_covers_zero_to_ninety_degrees(capsys):
    found = json_of(capsys, "front", "crossing7")
    intervals = [(row["optimal_from"], row["optimal_to"]) for row in found["front"]]
    assert intervals[0][0] == 0.0 and intervals[-1][1] == 90.0
    assert all(a[1] == pytest.approx(b[0]) for a, b in itertools.pairwise(intervals))


def test_predict_lambda_names_the_flips(capsys):
    """The angles are those of the altruist's and the egoist's optimum; the λ is the theory's."""
    found = json_of(capsys, "predict-lambda", "crossing7")
    first, *_, last = found["flips"]
    assert found["first_flip"] == first["lambda"] == pytest.approx(1.122, abs=1e-3)
    assert first["angle_before"] == pytest.approx(152.121, abs=1e-3)
    assert last["angle_after"] == pytest.approx(-42.274, abs=1e-3)
    assert (first["from"], first["to"], first["exact"]) == ("STOP", "FAST", 1)
    unit = found["target_norm"]
    assert first["in_units"] == pytest.approx(first["lambda"] * unit, abs=1e-5)


def test_predict_lambda_says_when_nothing_flips(capsys):
    assert main(["predict-lambda", "crossing7", "--angle", "90"]) == 0
    assert "no flip" in capsys.readouterr().out


def test_advantages_flip_where_rewards_do(capsys):
    rewards, advantages = (
        json_of(capsys, "predict-lambda", "crossing7", "--target-kind", kind)["flips"]
        for kind in ("instantaneous", "advantage")
    )
    assert [row["lambda"] for row in rewards] == pytest.approx([r["lambda"] for r in advantages])


@pytest.mark.parametrize("choice", [["--measure", "rows"], ["--next-value", "target"]])
def test_predict_lambda_for_batches_and_slow_copies_is_earlier(capsys, choice):
    exact = json_of(capsys, "predict-lambda", "crossing7")["first_flip"]
    assert json_of(capsys, "predict-lambda", "crossing7", *choice)["first_flip"] < exact


@pytest.mark.parametrize("world", ["crossing5", "crossing7"])
@pytest.mark.parametrize("extra", [[], ["--angle", "45"]])
def test_render_writes_a_png(tmp_path, world, extra):
    path = tmp_path / "picture.png"
    assert main(["render", world, "--out", str(path), *extra]) == 0
    assert path.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("file", "extra", "magic"),
    [
        ("picture.png", [], b"\x89PNG"),
        ("picture.png", ["--driver", "go", "--seed", "4"], b"\x89PNG"),
        pytest.param(
            "film.gif", ["--driver", "go", "--seed", "35"], b"GIF89a", marks=pytest.mark.slow
        ),
    ],
)
def test_render_draws_the_intersection(tmp_path, file, extra, magic):
    path = tmp_path / file
    assert main(["render", "intersection", "--out", str(path), *extra]) == 0
    assert path.read_bytes().startswith(magic)


def test_render_takes_a_policy_file_that_fits(tmp_path, capsys):
    weights, biases = np.zeros((3, 70), np.float32), np.array([0, 0, 1], np.float32)
    policy = tmp_path / "faster.safetensors"
    QPolicy((weights,), (biases,), "relu", 1.0).save(policy)
    path = tmp_path / "film.png"
    command = ["render", "intersection", "--driver", str(policy), "--out", str(path)]
    assert main(command) == 0 and path.exists()
    narrow = tmp_path / "narrow.safetensors"
    QPolicy((weights[:, :6],), (biases,), "relu", 1.0).save(narrow)
    command[3] = str(narrow)
    assert main(command) == 2
    assert "the world has 70 and 3" in capsys.readouterr().err


def test_evaluate_takes_drivers_of_the_intersection_by_name(capsys):
    command = ["evaluate", "go", "wait", "--world", "intersection", "--episodes", "30"]
    go, wait = json_of(capsys, *command)["policies"]
    assert go["collision"] + go["arrival"] == 1.0 and wait["timeout"] == 1.0
    assert go["collision_low"] < go["collision"] < go["collision_high"]
    assert (go["entries"], wait["entries"]) == (30, 0)
    assert main([*command[:3], "--world", "intersection"]) == 2
    assert "add --episodes N" in capsys.readouterr().err


def test_committed_results_are_shown_from_their_folder_or_the_one_above(capsys):
    folder = packaged_results()
    assert main(["reproduce", "poc", "--from", str(folder), "--json"]) == 0
    above = capsys.readouterr().out
    assert main(["reproduce", "poc", "--from", str(folder / "poc"), "--json"]) == 0
    assert capsys.readouterr().out == above
    assert json.loads(above)["study"] == "poc"


@pytest.mark.slow
def test_reproduce_intersection_world_in_small(tmp_path, capsys):
    out = tmp_path / "results"
    command = ["reproduce", "intersection-world", "--set", "episodes=8", "--seeds", "5"]
    found = json_of(capsys, *command, "--out", str(out))
    assert found["config"]["episodes"] == 8
    go = found["outcomes"]["highway_env"]["go"]
    assert go["collision"] + go["arrival"] + go["timeout"] == pytest.approx(1.0)
    assert {path.name for path in out.glob("*.png")} == {
        "fig_5_3.png",
        "gap_3s_episode.png",
        "outcomes.png",
    }


def test_collect_mixes_equal_numbers_of_episodes(demonstrations):
    counts = files.load(demonstrations).counts()
    assert {mode: episodes for mode, (episodes, _) in counts.items()} == {
        "egoistic": 3,
        "prosocial": 3,
        "altruistic": 3,
    }


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["--mixture", "weighted", "--weights", "2", "1", "1", "--episodes", "8"], (4, 2, 2)),
        (["--mixture", "contaminated", "--share", "0.25", "--episodes", "8"], (2, 6, 0)),
        (["--mixture", "equal_transitions", "--transitions", "75"], (25, None, 3)),
    ],
)
def test_collect_knows_every_mixture(tmp_path, capsys, options, expected):
    found = json_of(
        capsys, "collect", "crossing7", "--out", str(tmp_path / "data.safetensors"), *options
    )
    episodes = {row["mode"]: row["episodes"] for row in found["modes"]}
    for mode, count in zip(("egoistic", "prosocial", "altruistic"), expected, strict=True):
        assert count is None or episodes.get(mode, 0) == count


def test_train_writes_a_policy_for_every_angle_and_seed(run):
    record = json.loads((run / "run.json").read_text())
    assert [(one["angle"], one["seed"]) for one in record["policies"]] == [
        (0, 1),
        (0, 2),
        (90, 1),
        (90, 2),
    ]
    policy = QPolicy.load(run / "policy_angle90_seed2.safetensors")
    assert policy.provenance["numbers"]["angle"] == 90.0
    assert not (run / "checkpoint.safetensors").exists()


def test_train_records_every_chunk_and_lane_as_csv(run):
    with (run / "metrics.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 4  # one chunk of 20 updates, four lanes
    assert {"loss", "chi2", "prior", "max_q", "greedy_angle", "soft_angle"} <= set(rows[0])


def test_evaluate_is_exact_and_agrees_with_rollouts(run, capsys):
    policy = str(run / "policy_angle0_seed1.safetensors")
    exact = json_of(capsys, "evaluate", policy, "--world", "crossing7")
    rolled = json_of(capsys, "evaluate", policy, "--world", "crossing7", "--episodes", "2000")
    assert rolled["angle_low"] <= exact["angle"] <= rolled["angle_high"]
    assert exact["regret"] >= 0


def test_evaluate_pools_policies_by_their_mean_totals(run, capsys):
    files = [str(run / f"policy_angle0_seed{seed}.safetensors") for seed in (1, 2)]
    found = json_of(capsys, "evaluate", *files)
    each = [json_of(capsys, "evaluate", file) for file in files]
    for row, alone in zip(found["policies"], each, strict=True):
        assert {name: row[name] for name in alone} == alone
    mean = [sum(row[name] for row in each) / 2 for name in ("r_env", "r_social")]
    assert found["pooled"]["r_env"] == pytest.approx(mean[0], abs=1e-6)
    assert found["pooled"]["angle"] == pytest.approx(
        math.degrees(math.atan2(mean[1], mean[0])), abs=1e-4
    )


def test_evaluate_pools_no_angle_of_policies_of_different_angles(run, capsys):
    files = [str(run / f"policy_angle{angle}_seed1.safetensors") for angle in (0, 90)]
    pooled = json_of(capsys, "evaluate", *files)["pooled"]
    assert "angle" not in pooled
    assert pooled["angle_not_pooled"] == "the policies were trained for 0, 90 degrees"
    assert main(["evaluate", *files]) == 0
    assert (
        "No pooled angle: the policies were trained for 0, 90 degrees." in capsys.readouterr().out
    )


def test_evaluate_soft_differs_from_greedy(run, capsys):
    policy = str(run / "policy_angle0_seed1.safetensors")
    greedy = json_of(capsys, "evaluate", policy)
    soft = json_of(capsys, "evaluate", policy, "--soft")
    assert soft["r_env"] != greedy["r_env"]


def test_offline_training_needs_no_world(demonstrations, tmp_path):
    out = tmp_path / "offline"
    arguments = [
        "train",
        "iq-learn",
        str(demonstrations),
        "--value-term",
        "value_expert",
        "--out",
        str(out),
    ]
    assert main([*arguments, *TINY]) == 0
    assert (out / "policy_angle0.safetensors").is_file()


def test_any_gymnasium_environment_trains_online(tmp_path, capsys):
    import gymnasium

    from socialiq.evaluation.rollout import rollout_env

    class Leaning:
        """Pushes to the side to which the pole falls."""

        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            return (np.asarray(observation)[..., 2:].sum(axis=-1) > 0).astype(int), None

    shown = rollout_env(gymnasium.make("CartPole-v1"), Leaning(), 1, 0)
    data, out = tmp_path / "cartpole.safetensors", tmp_path / "run"
    files.save(data, shown.transitions)
    arguments = ["train", "iq-learn", str(data), "--world", "CartPole-v1", "--prior", "none"]
    assert main([*arguments, "--out", str(out), *TINY]) == 0
    capsys.readouterr()
    found = json_of(
        capsys,
        "evaluate",
        str(out / "policy_0.safetensors"),
        "--world",
        "CartPole-v1",
        "--episodes",
        "2",
    )
    assert found["r_env"] == found["length"] > 0


@pytest.mark.slow
def test_a_broken_lane_is_named_and_the_status_is_1(demonstrations, tmp_path, capsys):
    out = tmp_path / "broken"
    arguments = [
        "train",
        "iq-learn",
        str(demonstrations),
        "--world",
        "crossing7",
        "--out",
        str(out),
    ]
    assert main([*arguments, "--set", "learning_rate=1e30", *TINY]) == 1
    assert "not finite" in capsys.readouterr().err
    weights = QPolicy.load(out / "policy_angle0.safetensors").weights
    assert all(np.isfinite(weight).all() for weight in weights)


def test_claims_filters_by_verdict(capsys):
    every = json_of(capsys, "claims")
    untested = json_of(capsys, "claims", "--verdict", "untested")
    assert 0 < len(untested["claims"]) < len(every["claims"])
    assert {row["verdict"] for row in untested["claims"]} == {"untested"}


def test_help_shows_an_example_for_every_command(capsys):
    for command in COMMANDS:
        with pytest.raises(SystemExit) as stop:
            main([*command.split(), "--help"])
        assert stop.value.code == 0
        assert "Example: socialiq " in capsys.readouterr().out


@pytest.fixture(scope="module")
def clocked(tmp_path_factory):
    path = tmp_path_factory.mktemp("data") / "clocked.safetensors"
    arguments = ["collect", "crossing5", "--clock", "--episodes", "3", "--out", str(path)]
    assert main(arguments) == 0
    return path


@pytest.fixture(scope="module")
def dial(clocked, tmp_path_factory):
    out = tmp_path_factory.mktemp("dials") / "run"
    arguments = ["train", "dial", str(clocked), "--world", "crossing5", "--out", str(out)]
    assert main([*arguments, "--preset", "offline-redrawn", "--updates", "20"]) == 0
    return out / "dial_0.safetensors"


def test_train_dial_writes_its_record(dial):
    record = json.loads((dial.parent / "run.json").read_text())
    assert record["preset"] == "offline-redrawn"
    assert record["structure"]["redraw_times"] == 20
    assert record["dials"][0]["file"] == dial.name
    with (dial.parent / "metrics.csv").open() as file:
        (row,) = csv.DictReader(file)
    assert (row["updates"], row["seed"]) == ("20", "0")
    assert float(row["loss"]) == pytest.approx(record["dials"][0]["loss"], abs=1e-5)
    assert not (dial.parent / "checkpoint.safetensors").exists()


@pytest.fixture(scope="module")
def every_30(dial):
    """Figures that `dial` prints of the dial at every 30 degrees."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        assert main(["dial", "crossing5", "--policy", str(dial), "--every", "30", "--json"]) == 0
    return json.loads(printed.getvalue())


def test_dial_tells_what_each_angle_does(capsys, dial, every_30):
    found = every_30
    assert [row["angle"] for row in found["angles"]] == [0, 30, 60, 90]
    for row in found["angles"]:
        assert row["regret"] >= 0
        assert row["share_of_radius"] == "" or 0 <= row["share_of_radius"] <= 1 + 1e-9
    assert found["rise_r_env"] >= 0 and found["drop_r_social"] >= 0
    shown = sum(row["regret"] for row in found["angles"]) / 4
    assert found["mean_regret_every_30"] == pytest.approx(shown, abs=1e-6)
    whole = json_of(capsys, "dial", "crossing5", "--policy", str(dial), "--every", "1")
    assert found["mean_regret_every_1"] == whole["mean_regret_every_1"]
    assert [name for name in whole if name.startswith("mean_")] == ["mean_regret_every_1"]


def test_dial_tells_what_each_angle_does_at_the_intersection(capsys, tmp_path):
    path = tmp_path / "dial.safetensors"
    network = DialNetwork.initialise(jax.random.key(0), 70, (4,), 3)
    DialPolicy.of(network, temperature=0.1, low=0.0, high=90.0, provenance={}).save(path)
    options = ("--every", "45", "--episodes", "8", "--seed", "5")
    found = json_of(capsys, "dial", "intersection", "--policy", str(path), *options)
    assert (found["episodes"], found["seed"]) == (8, 5)
    assert [row["angle"] for row in found["angles"]] == [0, 45, 90]
    turned = tmp_path / "policy.safetensors"
    json_of(capsys, "turn", str(path), "--angle", "45", "--out", str(turned))
    options = ("--world", "intersection", "--episodes", "8", "--seed", "5")
    alone = json_of(capsys, "evaluate", str(turned), *options)
    for name in ("r_env", "r_social", "arrival", "collision"):
        assert found["angles"][1][name] == pytest.approx(alone[name], abs=1e-6)
    for row in found["angles"]:
        assert row["mix_angle"] == "" or row["mix_angle_low"] <= row["mix_angle_high"]


def test_a_turned_dial_is_evaluated_like_any_policy(capsys, dial, every_30, tmp_path):
    path = tmp_path / "policy.safetensors"
    json_of(capsys, "turn", str(dial), "--angle", "30", "--out", str(path))
    found = json_of(capsys, "evaluate", str(path), "--world", "crossing5", "--angle", "30")
    row = every_30["angles"][1]
    assert found["regret"] == pytest.approx(row["regret"], abs=1e-6)
    assert found["r_env"] == pytest.approx(row["r_env"], abs=1e-6)
