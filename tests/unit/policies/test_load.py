import hashlib
import json
import os
import sys

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.evaluation.simulate import SoftPolicy
from socialiq.policies import interface as content
from socialiq.policies.load import load_policy
from socialiq.types import Policy


def test_stable_baselines_zip_of_the_example(crafted):
    path = crafted.examples / "dqn_intersection.zip"
    loaded = load_policy(str(path), 70, 3)
    assert isinstance(loaded.policy, Policy) and isinstance(loaded.policy, SoftPolicy)
    assert loaded.record.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    record = json.loads(json.dumps(loaded.record.as_json()))
    assert record["kind"] == "sb3" and record["layers"] == [70, 64, 64, 3]
    assert (record["n_features"], record["n_actions"], record["soft"]) == (70, 3, True)


def test_stable_baselines_zip_names_its_sizes_itself(crafted):
    path = crafted.examples / "dqn_intersection.zip"
    record = load_policy(path).record
    assert record.interface == load_policy(path, 70, 3).record.interface
    assert record.as_json() == load_policy(path, 70, 3).record.as_json()


def test_neither_torch_nor_stable_baselines_is_imported(crafted, monkeypatch):
    for name in ("torch", "stable_baselines3", "cloudpickle"):
        monkeypatch.setitem(sys.modules, name, None)
    policy = load_policy(str(crafted.examples / "dqn_intersection.zip"), 70, 3).policy
    assert policy.predict(np.zeros((5, 70), np.float32))[0].shape == (5,)


def test_missing_extra_is_told(crafted, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(UserError, match=r"pip install 'socialiq\[onnx\]'"):
        load_policy(str(crafted.examples / "dqn_intersection.onnx"), 70, 3)


@pytest.mark.parametrize("spec", ["policy.pt", "policy", "", "other:policy", "<script>", "process"])
def test_unknown_kinds_are_refused(spec):
    with pytest.raises(UserError, match="unknown kind of policy"):
        load_policy(spec, 70, 3)


@pytest.mark.parametrize("suffix", [".zip", ".onnx", ".safetensors"])
def test_missing_file_folder_and_pipe_are_refused(tmp_path, suffix):
    (tmp_path / f"folder{suffix}").mkdir()
    os.mkfifo(tmp_path / f"pipe{suffix}")
    for name in ("missing", "folder", "pipe"):
        with pytest.raises(UserError, match=r"no such file|is a folder|not a regular file"):
            load_policy(str(tmp_path / f"{name}{suffix}"), 70, 3)


@pytest.mark.parametrize("suffix", [".zip", ".onnx", ".safetensors"])
def test_large_files_are_not_read(tmp_path, crafted, suffix):
    path = tmp_path / f"large{suffix}"
    with path.open("wb") as file:
        file.truncate(50 * content.MOST_BYTES)  # no disk is used
    with crafted.bounded(2 * content.MOST_BYTES), pytest.raises(UserError, match="larger than"):
        load_policy(str(path), 70, 3)
