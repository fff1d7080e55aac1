import jax
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.dial_policy import DialPolicy
from socialiq.policies.load import load_policy
from socialiq.social.angle_rule import AngleRule
from socialiq.storage import load_arrays, save_arrays
from socialiq.worlds.situation import ContextPolicy

STATES = np.array([[2, 1, 1, 0, -1, 0], [0, 0, 4, 2, -1, 0], [3, 0, 0, 2, 1, 2]], np.float32)
WHEN = {"angle": 75, "approaching": {"at_least": 1}}
RULE = AngleRule.of({"format": 1, "world": "crossing7", "default": 10, "when": [WHEN]})


@pytest.fixture(name="dial", params=["6 features", "7 features"])
def some_dial(request):
    features = int(request.param[0])
    network = DialNetwork.initialise(jax.random.key(1), features, (16,), 3, pairs=True)
    return DialPolicy.of(network, 0.1, 0.0, 90.0, {"learner": "test"})


def seen_by(dial: DialPolicy) -> np.ndarray:
    return STATES if dial.n_features == 6 else np.column_stack([STATES, np.float32([0, 5, 9])])


def test_it_decides_as_the_dial_at_the_angle_of_each_situation(dial):
    policy, seen = ContextPolicy.of(dial, RULE), seen_by(dial)
    assert policy.angles(seen)[0].tolist() == [75.0, 10.0, 75.0]
    values = policy.q_values(seen)
    for row, angle in enumerate((75.0, 10.0, 75.0)):
        np.testing.assert_allclose(values[row], dial.at(angle).q_values(seen)[row], atol=1e-6)


def test_its_file_holds_dial_and_rule(dial, tmp_path):
    policy, path = ContextPolicy.of(dial, RULE), tmp_path / "policy.safetensors"
    sha256 = policy.save(path)
    loaded = ContextPolicy.load(path)
    assert isinstance(loaded, ContextPolicy) and loaded.sha256 == sha256
    assert loaded.rule == RULE
    np.testing.assert_array_equal(loaded.q_values(seen_by(dial)), policy.q_values(seen_by(dial)))
    record = load_policy(str(path), dial.n_features, 3).record
    assert record.kind == ContextPolicy.KIND and record.soft
    assert record.details["rule"] == RULE.as_json()


def test_an_angle_beyond_the_dial_or_another_world_is_refused(dial):
    for world, default, message in (
        ("crossing7", 120, "outside this dial's range"),
        ("crossing5", 30, "the dial takes"),
        ("highway", 30, "unknown world"),
    ):
        rule = AngleRule.of({"format": 1, "world": world, "default": default})
        with pytest.raises(UserError, match=message):
            ContextPolicy.of(dial, rule)


def test_a_damaged_rule_in_a_file_is_refused(dial, tmp_path):
    path = tmp_path / "policy.safetensors"
    ContextPolicy.of(dial, RULE).save(path)
    arrays, header = load_arrays(path, ContextPolicy.KIND, 1)
    for rule in (None, {}, RULE.as_json() | {"default": "a"}, {"format": 1, "world": "crossing7"}):
        changed = {key: one for key, one in header.items() if key not in ("kind", "version")}
        changed = {key: one for key, one in changed.items() if key != "sha256"}
        save_arrays(path, ContextPolicy.KIND, 1, arrays, changed | {"rule": rule})
        with pytest.raises(UserError, match=r"rule|default"):
            ContextPolicy.load(path)
