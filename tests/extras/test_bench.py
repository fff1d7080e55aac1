"""The benchmarks run to their end beside the real peers; their figures are not judged here."""

import json
from collections.abc import Callable
from typing import Any

import pytest

from socialiq.cli.main import main
from socialiq_lab.cli import commands as bench


@pytest.fixture(name="smaller")
def smaller_benchmarks(monkeypatch) -> Callable[..., None]:
    """Constants of the next benchmark: whole, it takes minutes."""

    def change(**constants: Any) -> None:
        load = bench.load

        def loaded(name):
            module = load(name)
            assert set(constants) <= set(vars(module))
            vars(module).update(constants)
            return module

        monkeypatch.setattr(bench, "load", loaded)

    return change


def test_bench_learners_prints_one_json_object(smaller, capsys):
    pytest.importorskip("torch", reason="extra `bench` is not installed")
    smaller(UPDATES=50, SWEEP_UPDATES=10)
    assert main(["bench", "learners", "--repeats", "1", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["ratio_to_torch"] > 0
    assert found["sweep_lanes"] == 65


def test_bench_worlds_prints_one_json_object(smaller, capsys):
    pytest.importorskip("highway_env", reason="extra `highway` is not installed")
    smaller(HIGHWAY_STEPS=10, SINGLE_STEPS=100, CORE_STEPS=1_024, EFFECTS_STEPS=640)
    assert main(["bench", "worlds", "--repeats", "1", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["ratio"] > 0
    assert found["steps_per_s_2_threads"] > 0


def test_bench_experts_prints_one_json_object(smaller, capsys):
    pytest.importorskip("stable_baselines3", reason="extra `sb3` is not installed")
    # Both sides take a few steps, the peer in two processes.
    smaller(ENVIRONMENTS=2, PEER_STEPS=24, OUR_STEPS=28_800)
    assert main(["bench", "experts", "--repeats", "1", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["ratio"] > 0
    assert found["share_of_matrix_throughput"] > 0


def test_bench_continuous_prints_one_json_object(smaller, capsys):
    pytest.importorskip("stable_baselines3", reason="extra `sb3` is not installed")
    smaller(SIZES={"small": (8, 8)}, ROUND=10, PEER_UPDATES=5, WARM_UP=10)
    assert main(["bench", "continuous", "--repeats", "1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["small_ratio"] > 0


def test_bench_dial_prints_one_json_object(smaller, capsys):
    smaller(SHARE=1000, CHUNK=20, QUICK_SEEDS=(50,))
    assert main(["bench", "dial", "--repeats", "1", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["intersection_thesis_updates"] == found["intersection_dial_updates"]
    assert found["crossing7_ratio"] > 0 and found["intersection_ratio"] > 0
    assert found["crossing7_quick_ratio"] > 0
    assert 0 <= found["crossing7_quick_regret"] <= found["crossing7_quick_worst_seed"]


def test_bench_recordings_prints_one_json_object(smaller, capsys):
    smaller(N_TRACKS=20, N_FRAMES=200, N_JUNCTIONS=1, N_CARS=4)
    assert main(["bench", "recordings", "--repeats", "1", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    for layout in ("commonroad", "ind", "interaction", "ngsim"):
        assert found[f"{layout}_states_per_s"] > 0
    assert found["conflicts_per_import"] > 0 and found["conflicts"] == 3
    assert found["bytes_per_state_8000"] < 1.2 * found["bytes_per_state_4000"]


def test_bench_junction_prints_one_json_object(smaller, capsys):
    smaller(EACH=4, BATCH=4, DECISIONS=10)
    assert main(["bench", "junction", "--repeats", "1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["decisions_per_s"] > 0


def test_bench_devices_prints_one_json_object(smaller, capsys):
    smaller(RUNS={"crossing7": (2,), "intersection_offline": (1,)}, CHUNKS=2, EPISODES=4)
    assert main(["bench", "devices", "--repeats", "1", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["crossing7_2_runs_cpu"] > 0
    assert found["intersection_offline_1_runs_cpu"] > 0
