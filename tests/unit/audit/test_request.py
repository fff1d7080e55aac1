"""The command that repeats an audit."""

import contextlib
import dataclasses
from pathlib import Path

import jax
import numpy as np
import pytest

from socialiq.audit import request
from socialiq.audit.request import (
    Request,
    Trust,
    command_of,
    dial_angles,
    resolve_policy,
    resolve_references,
)
from socialiq.errors import UserError
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.policies.interface import Interface, Record
from socialiq.policies.load import load_policy
from socialiq.policies.process import GIB, Limits
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Intersection
from socialiq.worlds.registry import make


def test_the_command_names_what_was_not_usual():
    plain = Request("atlas:prosocial", Path("a profile.toml"), 50)
    start = "socialiq audit atlas:prosocial --profile 'a profile.toml' --episodes 50 --seed 7"
    assert command_of(plain, 7) == start
    assert command_of(dataclasses.replace(plain, log=Path("log")), 7) == start
    slow = Trust(limits=Limits(step=12.5, memory=GIB // 2))
    asked = Request("atlas:prosocial", Path("a profile.toml"), 50, shift=(), trust=slow)
    assert command_of(asked, 7) == f"{start} --shift --step-seconds 12.5 --memory-gib 0.5"


CROSSING, JUNCTION = make("crossing7"), Intersection(Options())
OTHER = Record("table", "other", "00" * 32, "its bytes", Interface(5, 3), False)
"""Record of a policy that is no reference."""


def dial(folder, features=CROSSING.n_features, high=90.0):
    path = folder / "dial.safetensors"
    network = DialNetwork.initialise(jax.random.key(0), features, (4,), CROSSING.n_actions)
    DialPolicy.of(network, 1.0, 0.0, high, {}).save(path)
    return path


def references_of(world, specs, policy, trust):
    with contextlib.ExitStack() as closing:
        angles = dial_angles(45.0, 15.0)
        return resolve_references(world, specs, policy.as_json(), trust, closing, angles)


def named(references):
    return [one.name for one in references]


def test_the_junction_has_gap_rules_and_experts():
    found, records, itself = references_of(JUNCTION, [], OTHER, Trust())
    gaps, modes = ["gap_2s", "gap_3s", "gap_4s"], ["egoistic", "prosocial", "altruistic"]
    experts = [f"{family}_{mode}" for family in ("expert", "set") for mode in modes]
    angles = [0.0, 15.0, 30.0, 35.0, 40.0, 45.0, 50.0, 55.0, 60.0, 75.0, 90.0]
    assert named(found) == [f"dial_{angle:g}" for angle in angles] + gaps + experts
    assert [one.angle for one in found] == angles + [None] * 9
    assert set(records) == set(named(found)) and itself == []


def test_an_expert_of_the_atlas_knows_its_twin():
    one = resolve_policy("atlas:expert_egoistic", JUNCTION, 0.0, Trust())
    assert one.record.source == "atlas:expert_egoistic"
    itself = references_of(JUNCTION, [], one.record, Trust()).itself
    assert itself == ["expert_egoistic"]


def test_the_atlas_has_entries_for_each_kind_of_actions():
    steered = make("intersection-continuous")
    one = resolve_policy("atlas:expert_egoistic", steered, 0.0, Trust())
    # Its networks see the time.
    assert one.record.interface == Interface(JUNCTION.n_features + 1, 0, 1, "rows-1")
    with pytest.raises(UserError, match=r"'prosocial': choose one of expert_egoistic, [^s]"):
        resolve_policy("atlas:prosocial", steered, 0.0, Trust())


def test_a_rule_knows_its_twin():
    waits = resolve_policy("wait", JUNCTION, 90.0, Trust()).record
    assert waits.kind == "rule"
    assert references_of(JUNCTION, [], waits, Trust()).itself == ["wait"]
    gap = resolve_policy("gap_3s", JUNCTION, 90.0, Trust()).record
    assert references_of(JUNCTION, [], gap, Trust()).itself == ["gap_3s"]


@pytest.mark.parametrize("clock", [0, 1])
def test_a_dial_is_a_family_of_references(tmp_path, clock):
    path = dial(tmp_path, CROSSING.n_features + clock, high=60.0)
    found, records, _ = references_of(CROSSING, [path], OTHER, Trust())
    assert [one.angle for one in found] == [0.0, 15.0, 30.0, 35.0, 40.0, 45.0, 50.0, 55.0, 60.0]
    assert named(found)[1] == "dial at 15"
    assert len({record["sha256"] for record in records.values()}) == 9


def test_a_dial_under_audit_is_turned_to_the_declared_angle(tmp_path):
    path = dial(tmp_path)
    seen = np.zeros((1, CROSSING.n_features), np.float32)
    turned = resolve_policy(str(path), CROSSING, 30.0, Trust())
    expected = DialPolicy.load(path).at(30.0).q_values(seen)
    assert isinstance(turned.policy, QPolicy)
    np.testing.assert_array_equal(turned.policy.q_values(seen), expected)


@pytest.mark.parametrize(
    ("spec", "mend"),
    [
        ("atlas:absent", "choose one of expert_egoistic"),
        ("absent", "name one of FILE.safetensors"),
        ("wait", "name one of FILE.safetensors"),
        ("atlas:baseline", "name the world it was made for"),
    ],
)
def test_who_is_not_there_or_does_not_fit(spec, mend):
    with pytest.raises(UserError, match=mend):
        resolve_policy(spec, CROSSING, 0.0, Trust())


def test_references_are_files(tmp_path):
    from pathlib import Path

    with pytest.raises(UserError, match="a reference is a policy's file"):
        references_of(CROSSING, [Path("process:touch x")], OTHER, Trust())


CODE = """
def never(observations):
    return [0 for _ in observations]
"""


def test_references_in_python_end_when_they_are_closed(tmp_path):
    (tmp_path / "theirs.py").write_text(CODE)
    specs = [f"python:{tmp_path / 'theirs.py'}:never"]
    with contextlib.ExitStack() as closing:
        trust = Trust(allow_code=True)
        found = resolve_references(CROSSING, specs, OTHER.as_json(), trust, closing, ())
        seen = np.zeros((1, CROSSING.n_features), np.float32)
        assert named(found.drivers) == ["never"]
        assert found.drivers[0].policy.predict(seen)[0].tolist() == [0]
    with pytest.raises(UserError, match="was ended"):
        found.drivers[0].policy.predict(seen)


def test_references_end_if_a_later_one_is_refused(tmp_path, monkeypatch):
    (tmp_path / "theirs.py").write_text(CODE)
    started = []

    def load(*arguments, **more):
        started.append(load_policy(*arguments, **more))
        return started[-1]

    monkeypatch.setattr(request, "load_policy", load)
    specs = [f"python:{tmp_path / 'theirs.py'}:never", "python:no/such.py:f"]
    with pytest.raises(UserError, match="no such file"):
        references_of(CROSSING, specs, OTHER, Trust(allow_code=True))
    (only,) = started
    with pytest.raises(UserError, match="was ended"):
        only.policy.predict(np.zeros((1, CROSSING.n_features), np.float32))
