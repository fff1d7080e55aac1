import dataclasses

import jax
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.learners.dial.config import DialConfig, DialHyperparameters
from socialiq.learners.dial.rows import draw_directions
from socialiq.learners.dial.train import train
from socialiq.nn.class_dial import ClassDial
from socialiq.types import ByClass
from socialiq.worlds.registry import make_grid

CONFIG = DialConfig(
    classes=True,
    demonstrations=False,
    hidden=(8,),
    replay_batch=8,
    updates=40,
    environments=2,
    replay_capacity=50,
)


@pytest.mark.parametrize("heads", ["score", "pair"])
def test_a_dial_of_two_angles_trains_from_the_world_alone(heads):
    world = make_grid("crosswalk7").with_parts().with_clock()
    how = {"heads": heads, "backup": "double", "driven_share": 0.5, "redraw_times": 25}
    trained = train(dataclasses.replace(CONFIG, **how), DialHyperparameters(), (), world, chunk=20)
    assert trained.failures == ()
    dial = trained.policy(0)
    assert isinstance(dial, ClassDial)
    assert (dial.n_features, dial.n_actions, dial.pairs) == (8, 3, heads == "pair")


def test_directions_are_drawn_from_the_octant_and_its_margin():
    drawn = draw_directions(jax.random.key(0), 4000, CONFIG, classes=True)
    assert isinstance(drawn.social, ByClass)
    env, vehicle, vulnerable = map(np.asarray, drawn.parts)
    np.testing.assert_allclose(env**2 + vehicle**2 + vulnerable**2, 1.0, atol=1e-5)
    angle, sign = np.degrees(np.arccos(env)), np.sign(vehicle + vulnerable)
    class_angle = np.degrees(np.arctan2(sign * vulnerable, sign * vehicle))
    for angles in (sign * angle, class_angle):
        assert -5.0 <= angles.min() < -4.0
        assert 94.0 < angles.max() <= 95.001


@pytest.mark.parametrize(
    ("fields", "line"),
    [
        ({"demonstrations": True}, "--set demonstrations=false"),
        ({"knots": 5}, "--set knots is of one angle"),
    ],
)
def test_what_does_not_go_with_classes_is_refused(fields, line):
    with pytest.raises(UserError, match=line):
        dataclasses.replace(CONFIG, **fields)
