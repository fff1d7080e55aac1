import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.nn.class_dial import ClassDial
from socialiq.nn.dial_network import DialNetwork
from socialiq.social.angle import direction_of
from socialiq.storage import load_arrays, save_arrays

OBSERVATIONS = np.random.default_rng(0).integers(0, 3, (20, 2)).astype(np.float32)
KINDS = {"plain": {}, "one_hot": {"one_hot": ((0, 3), (0, 3))}, "pairs": {"pairs": True}}


@pytest.fixture(name="network", params=KINDS)
def some_network(request):
    shape = jax.random.key(0), 2, (16, 8), 3
    return DialNetwork.initialise(*shape, classes=True, **KINDS[request.param])


@pytest.fixture(name="dial")
def some_dial(network):
    return ClassDial.of(network, 0.5, 0.0, 90.0, {"learner": "test"})


@pytest.mark.parametrize("angles", [(0.0, 30.0), (60.0, 0.0), (37.0, 52.0), (90.0, 90.0)])
def test_the_dial_of_a_class_angle_is_the_network_asked_at_both(network, dial, angles):
    direction = jax.tree.map(lambda part: jnp.full(20, part), direction_of(*angles))
    expected = jax.vmap(network)(OBSERVATIONS, direction)
    turned = dial.of_class(angles[1])
    np.testing.assert_allclose(turned.at(angles[0]).q_values(OBSERVATIONS), expected, atol=1e-5)
    assert (turned.n_features, turned.n_actions) == (dial.n_features, dial.n_actions) == (2, 3)
    assert turned.provenance["class_angle"] == angles[1]


def test_a_dial_is_the_same_after_it_was_saved(dial, tmp_path):
    dial.save(tmp_path / "dial.safetensors")
    loaded = ClassDial.load(tmp_path / "dial.safetensors")
    assert (loaded.low, loaded.high, loaded.pairs) == (0.0, 90.0, dial.pairs)
    first, second = (one.of_class(20.0).at(70.0).q_values(OBSERVATIONS) for one in (dial, loaded))
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("header", [{"pairs": 1}, {"low": "a"}, {"low": 90.0, "high": 0.0}])
def test_a_damaged_header_is_refused(dial, header, tmp_path):
    path = tmp_path / "dial.safetensors"
    dial.save(path)
    arrays, saved = load_arrays(path, ClassDial.KIND, ClassDial.VERSIONS)
    changed = {name: part for name, part in saved.items() if name != "sha256"} | header
    save_arrays(path, ClassDial.KIND, 1, arrays, changed)
    with pytest.raises(UserError, match=r"dial\.safetensors"):
        ClassDial.load(path)


def test_a_class_angle_outside_the_octant_is_refused(dial):
    with pytest.raises(UserError, match=r"class angle 95 is outside \[0, 90\] degrees"):
        dial.of_class(95.0)
