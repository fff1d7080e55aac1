"""Saved policies act by NumPy alone, as the trained JAX networks do."""

import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.nn.actor import Actor
from socialiq.nn.actor_policy import ActorPolicy
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_network import DuelingNetwork, QNetwork
from socialiq.nn.q_policy import QPolicy
from socialiq.nn.view import CHOICES, ROW
from socialiq.social.angle import exact_weights
from socialiq.types import RewardPair

KEY = jax.random.key(0)
FEATURES = 4 * ROW
ROWS = 10_000
ONE_HOT = ((0, 3),) * FEATURES

LIGHT = (
    *("policies.load", "evaluation.rollout", "audit.conduct", "view.open", "page.write"),
    *("cli.main", "cli.audit", "cli.data", "cli.dial", "cli.evaluate", "cli.export"),
)
"""Modules of acting, evaluating and exporting."""


def scenes(times: int = 0) -> np.ndarray:
    """Random vehicles, some of them absent; with the time at the end."""
    rng = np.random.default_rng(0)
    rows = rng.uniform(-1, 1, (ROWS, FEATURES // ROW, ROW)).astype(np.float32)
    rows[..., 0] = rng.random(rows.shape[:2]) < 0.5
    scene = rows.reshape(ROWS, -1)
    if not times:
        return scene
    return np.column_stack([scene, rng.integers(times, size=ROWS)]).astype(np.float32)


def check(policy: QPolicy, wanted: jax.Array, seen: np.ndarray) -> None:
    """The values agree up to an offset of the state, and the best actions where they differ."""
    values, expected = policy.q_values(seen), np.asarray(wanted)
    difference = values - expected
    difference -= difference.mean(axis=1, keepdims=True)
    np.testing.assert_allclose(difference, 0.0, atol=1e-5)
    best = expected.argmax(axis=1)
    np.testing.assert_array_equal(policy.predict(seen)[0], best)
    np.testing.assert_array_equal([policy.predict(row)[0] for row in seen[:20]], best[:20])


@pytest.mark.parametrize(
    ("view", "activation"), [("flat", "elu"), *((view, "relu") for view in CHOICES)]
)
def test_networks(view, activation):
    network = QNetwork.initialise(KEY, FEATURES, (16, 8), 3, activation, view)
    check(QPolicy.of(network, 1.0, {}), jax.vmap(network)(scenes()), scenes())


def test_a_network_with_a_scale_and_one_with_the_time():
    scaled = QNetwork.initialise(KEY, FEATURES, (16,), 3, scale=0.2)
    check(QPolicy.of(scaled, 1.0, {}), jax.vmap(scaled)(scenes()), scenes())
    timed = QNetwork.initialise(KEY, FEATURES + 1, (16,), 3, view="set", times=5)
    check(QPolicy.of(timed, 1.0, {}), jax.vmap(timed)(scenes(5)), scenes(5))


def test_integers_one_hot():
    network = QNetwork.initialise(KEY, FEATURES, (16,), 3, one_hot=ONE_HOT)
    whole = np.random.default_rng(0).integers(-1, 4, (ROWS, FEATURES)).astype(np.float32)
    check(QPolicy.of(network, 1.0, {}), jax.vmap(network)(whole), whole)


def test_value_and_policy_apart():
    network = DuelingNetwork.initialise(KEY, 0.5, FEATURES, (16,), 3, view="set")
    check(QPolicy.of(network, 0.5, {}), jax.vmap(network)(scenes()), scenes())


@pytest.mark.parametrize("pairs", [False, True])
@pytest.mark.parametrize("knots", [(), (0.0, 45.0, 90.0)])
def test_dials(pairs, knots):
    network = DialNetwork.initialise(
        KEY, FEATURES, (16, 8), 3, view="set", pairs=pairs, knots=knots
    )
    dial = DialPolicy.of(network, 1.0, 0.0, 90.0, {})
    direction = RewardPair(*(jnp.float32(weight) for weight in exact_weights(30.0)))
    wanted = jax.vmap(lambda row: network(row, direction))(scenes())
    check(dial.at(30.0), wanted, scenes())


@pytest.mark.parametrize("stochastic", [False, True])
def test_actors(stochastic):
    actor = Actor.initialise(KEY, FEATURES, (16, 8), 2, stochastic=stochastic, view="set_ahead")
    policy, (mean, log_std) = ActorPolicy.of(actor, {}), jax.vmap(actor)(scenes())
    found, deviation = policy.gaussian(scenes())
    np.testing.assert_allclose(found, mean, atol=1e-5)
    np.testing.assert_allclose(deviation, np.exp(log_std) if stochastic else 0.0, atol=1e-5)
    np.testing.assert_allclose(policy.predict(scenes())[0], np.tanh(mean), atol=1e-5)


def test_acting_needs_no_jax():
    """With no JAX to import, policies load and act, and a gridworld says what it needs."""
    imports = "; ".join(f"import socialiq.{module}" for module in LIGHT)
    program = (
        "import sys; sys.modules.update(dict.fromkeys(('jax', 'jaxlib', 'equinox', 'optax'))); "
        f"import numpy as np; {imports}; import socialiq; "
        "layers = (np.ones((3, 2), np.float32),), (np.arange(3, dtype=np.float32),); "
        "policy = socialiq.QPolicy(*layers, 'relu', 1.0); print(policy.predict(np.zeros(2))[0])\n"
        "try: socialiq.tabulate(socialiq.make('crossing7'))\n"
        "except socialiq.UserError as error: print(error)"
    )
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", program], capture_output=True, text=True
    )
    action, message = done.stdout.splitlines() or ("", done.stderr)
    assert action == "2" and message.endswith("run pip install 'socialiq[learn]'"), done.stderr
