import json
from itertools import pairwise

import numpy as np
import pytest

import socialiq
from socialiq.errors import UserError
from socialiq.nn.actor_policy import ActorPolicy
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.nn.view import Choice, OneHot, View
from socialiq.policies.load import load_policy
from socialiq.storage import save_arrays

pytestmark = pytest.mark.usefixtures("as_a_user_runs_it")
RANDOM = np.random.default_rng(0)
OBSERVATIONS = RANDOM.normal(size=(50, 14)).astype(np.float32)


def arrays(*sizes):
    return tuple(
        RANDOM.normal(size=(outputs, inputs)).astype(np.float32)
        for inputs, outputs in pairwise(sizes)
    )


def zeros(*sizes):
    return tuple(np.zeros(size, np.float32) for size in sizes)


def policy(**other):
    fields = {
        "weights": arrays(14, 8, 3),
        "biases": zeros(8, 3),
        "activation": "relu",
        "temperature": 0.5,
        "provenance": {"learner": "test"},
    }
    return QPolicy(**(fields | other))


def dial(**other):
    return DialPolicy(policy(weights=arrays(16, 8, 3), **other), 0.0, 90.0)


def pooled():
    view = View(arrays(13, 64, 64), zeros(64, 64), Choice(True, True, 5.0), 14)
    return policy(weights=arrays(view.width, 8, 3), view=view)


def one_hot():
    return policy(weights=arrays(14 * 4, 8, 3), view=OneHot((0,) * 14, (4,) * 14))


@pytest.mark.parametrize("make", [policy, pooled, one_hot])
def test_policy_is_the_one_that_was_saved(tmp_path, make):
    saved = make()
    sha256 = saved.save(tmp_path / "p.safetensors")
    loaded = load_policy(str(tmp_path / "p.safetensors"), 14, 3)
    expected = saved.predict(OBSERVATIONS)[0]
    np.testing.assert_array_equal(loaded.policy.predict(OBSERVATIONS)[0], expected)
    record = loaded.record.as_json()
    assert (record["kind"], record["content_sha256"], record["soft"]) == ("policy", sha256, True)


def test_file_or_object_names_its_sizes_itself(tmp_path):
    actor = ActorPolicy(arrays(14, 8, 2), zeros(8, 2), "relu", 1)
    for saved, sizes in [(policy(), (14, 3, 0)), (dial(), (14, 3, 0)), (actor, (14, 0, 1))]:
        path = tmp_path / f"{saved.KIND}.safetensors"
        saved.save(path)
        angle = 30.0 if saved.KIND == "dial" else None
        for spec in (str(path), path, saved):
            loaded = load_policy(spec, angle=angle)
            assert loaded.record.interface[:3] == sizes
            assert loaded.policy.predict(OBSERVATIONS)[0].shape == (50, 1)[: 1 + sizes[2]]
    with pytest.raises(UserError, match="takes 14 features and 3 actions, the world has 14 and 4"):
        load_policy(tmp_path / "policy.safetensors", n_actions=4)
    for spec in ("process:true", "python:theirs.py:careful"):
        with pytest.raises(UserError, match=f"^{spec} names no sizes: give n_features and n_act"):
            load_policy(spec)
    with pytest.raises(UserError, match=r"unknown kind of policy 'policy.pt'"):
        load_policy("policy.pt")


def test_dial_is_audited_at_an_angle(tmp_path):
    saved, path = dial(), tmp_path / "d.safetensors"
    saved.save(path)
    loaded = load_policy(str(path), 14, 3, angle=30.0)
    np.testing.assert_array_equal(
        loaded.policy.predict(OBSERVATIONS)[0], saved.at(30.0).predict(OBSERVATIONS)[0]
    )
    assert loaded.record.kind == "dial" and loaded.record.details["angle"] == 30.0


def test_dial_needs_an_angle_of_its_range(tmp_path):
    path = tmp_path / "d.safetensors"
    dial().save(path)
    with pytest.raises(UserError, match="name an angle"):
        load_policy(str(path), 14, 3)
    with pytest.raises(UserError, match="outside this dial's range"):
        load_policy(str(path), 14, 3, angle=120.0)


def test_file_of_another_world_is_refused(tmp_path):
    policy().save(tmp_path / "p.safetensors")
    dial().save(tmp_path / "d.safetensors")
    for name in "pd":
        with pytest.raises(UserError, match="takes 14 features and 3 actions, the world has 70"):
            load_policy(str(tmp_path / f"{name}.safetensors"), 70, 3, angle=0.0)


def refused(tmp_path, match, kind="policy", version=2, drop=(), changed=None, **header):
    """Save a file whose checksum is right and whose content isn't."""
    stored, said = (policy() if kind == "policy" else dial().turned).content()
    stored = {name: array for name, array in stored.items() if name not in drop}
    said = {name: value for name, value in (said | header).items() if name not in drop}
    path = tmp_path / "p.safetensors"
    save_arrays(path, kind, version, stored | (changed or {}), said)
    with pytest.raises(UserError, match=match) as caught:
        load_policy(str(path), 14, 3, angle=0.0)
    assert "\n" not in str(caught.value)


def test_header_must_be_borne_out(tmp_path):
    assert socialiq.QPolicy.KIND  # the public class refuses values of its own accord
    for name in ("activation", "temperature", "provenance", "view", "weight_1", "bias_0"):
        refused(tmp_path, "header that doesn't fit its arrays", drop=(name,))
    for layers in (0, -1, 10**12, "2", None, True):
        refused(tmp_path, "must have 1 to 100 layers", layers=layers)
    refused(tmp_path, "doesn't fit its arrays", layers=3)
    refused(tmp_path, "don't follow", activation="os.system")
    for temperature in (0.0, -1.0, float("inf"), float("nan"), "1"):
        refused(tmp_path, "don't follow", temperature=temperature)
    refused(tmp_path, "don't follow", provenance=[1])
    refused(tmp_path, "more than 65,536 characters", provenance={"note": "x" * 70_000})


def test_arrays_must_follow_one_another(tmp_path):
    refused(tmp_path, "don't follow", changed={"weight_1": np.zeros((3, 9), np.float32)})
    refused(tmp_path, "don't follow", changed={"bias_1": np.zeros(4, np.float32)})
    refused(tmp_path, "doesn't fit", changed={"weight_0": np.zeros(14, np.float32)})
    refused(
        tmp_path, "not a finite number", changed={"bias_1": np.array([0, np.nan, 0], np.float32)}
    )
    refused(tmp_path, "not a finite number", changed={"bias_1": np.zeros(3, bool)})


def test_views_must_be_borne_out(tmp_path, crafted):
    huge = {"lows": [0] * 14, "sizes": [10**12] * 14}
    with crafted.bounded(5_000_000):
        refused(tmp_path, "don't follow", one_hot=huge)
    for lows, sizes in (([0], [4, 4]), (["0"], [4]), ([0], [-4]), ([0.5], [4])):
        refused(tmp_path, "don't follow", one_hot={"lows": lows, "sizes": sizes})
    refused(tmp_path, "doesn't fit its arrays", one_hot={"lows": 3, "sizes": None})
    plain = {"pooled": False, "relative": False, "scale": 1.0, "layers": 0, "n_features": 14}
    for changed in (
        {"n_features": 15},
        {"n_features": 7 * 10**12},
        {"scale": "1"},
        {"pooled": True},
    ):
        refused(tmp_path, "don't follow", view=plain | changed)
    refused(tmp_path, "doesn't fit its arrays", view={"pooled": False})
    refused(tmp_path, "doesn't fit its arrays", view=plain | {"layers": 1})


def test_dial_tells_its_range(tmp_path):
    wide = {"weight_0": np.zeros((8, 16), np.float32)}
    refused(tmp_path, "no range of angles", kind="dial", version=1, changed=wide, low=0.0)
    refused(
        tmp_path,
        "don't follow",
        kind="dial",
        version=1,
        changed={"weight_0": np.zeros((8, 1))},
    )


def test_damaged_files_are_refused(tmp_path):
    path = tmp_path / "p.safetensors"
    policy().save(path)
    content = path.read_bytes()
    for broken in (
        b"",
        content[:100],
        content[:-1],
        b"\xff" * 100,
        content.replace(b"relu", b"ruel"),
    ):
        path.write_bytes(broken)
        with pytest.raises(UserError, match="damaged"):
            load_policy(str(path), 14, 3)


def test_safetensors_with_an_absurd_header_is_refused(tmp_path, crafted):
    path = tmp_path / "p.safetensors"
    for said in (b'{"a":{"dtype":"F32","shape":[99999999999],"data_offsets":[0,4]}}', b"[" * 9_999):
        path.write_bytes(len(said).to_bytes(8, "little") + said + bytes(4))
        with pytest.raises(UserError, match="damaged"):
            load_policy(str(path), 14, 3)
    path.write_bytes((2**63).to_bytes(8, "little"))
    with pytest.raises(UserError, match="damaged"):
        load_policy(str(path), 14, 3)


@pytest.mark.parametrize("kind", ["BF16", "F8_E4M3"])
def test_numbers_that_numpy_lacks_are_refused(tmp_path, kind):
    size = 2 if kind == "BF16" else 1
    entry = json.dumps({"a": {"dtype": kind, "shape": [1], "data_offsets": [0, size]}})
    path = tmp_path / "p.safetensors"
    path.write_bytes(len(entry).to_bytes(8, "little") + entry.encode() + bytes(size))
    with pytest.raises(UserError):
        load_policy(str(path), 14, 3)
