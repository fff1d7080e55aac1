"""The benchmark runs to its end beside the real PyTorch; its figures are not judged here."""

import json

import pytest

from socialiq.cli.main import main

pytest.importorskip("torch", reason="extra `bench` is not installed")


def test_bench_learners_prints_one_json_object(capsys):
    assert main(["bench", "learners", "--repeats", "1", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["ratio_to_torch"] > 0
    assert found["sweep_lanes"] == 65
