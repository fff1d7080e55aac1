"""Views of a list of vehicles: invariances, and the relative columns by hand."""

from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.nn.q_network import QNetwork, affine_layers, encoding
from socialiq.nn.q_policy import QPolicy
from socialiq.nn.view import (
    CHOICES,
    ROUTE,
    ROW,
    SECONDS,
    Choice,
    OneHot,
    PresentRows,
    View,
    closeness,
)

VEHICLES = 4  # the ego's row, two others, and an empty row
NAMES = sorted(CHOICES)
POOLED = [name for name in NAMES if name.startswith("set")]
FLAT = [name for name in NAMES if name.startswith("flat")]
RELATIVE = Choice(pooled=False, relative=True, scale=1.0)


def observations(count: int = 6) -> np.ndarray:
    """Random scenes, (count, vehicle, 7), of which the last row is empty."""
    rows = np.random.default_rng(0).uniform(-1, 1, (count, VEHICLES, ROW)).astype(np.float32)
    rows[:, :-1, 0], rows[:, -1] = 1.0, 0.0
    return rows


def flattened(rows: np.ndarray) -> np.ndarray:
    return rows.reshape(len(rows), -1)


def network(name: str, hidden: tuple[int, ...] = (8,)) -> QNetwork:
    return QNetwork.initialise(jax.random.key(0), VEHICLES * ROW, hidden, 3, view=name)


def policy(name: str) -> QPolicy:
    return QPolicy.of(network(name), 0.5, {"view": name})


def of_others(choice: Choice, ego: list[float], other: list[float]) -> np.ndarray:
    """The view of a single other vehicle, from rows without their presence."""
    rows = np.array([[1.0, *ego], [1.0, *other]])
    return View((), (), choice, 2 * ROW)(rows.ravel())[ROW - 1 :]


def test_all_views_are_pooled_or_flat():
    assert {*POOLED} == {name for name, choice in CHOICES.items() if choice and choice.pooled}
    assert {*POOLED} | {*FLAT} == {*CHOICES}


@pytest.mark.parametrize("name", NAMES)
def test_the_order_of_the_others_matters_to_flat_views_alone(name):
    rows = observations()
    q, swapped = (
        policy(name).q_values(flattened(rows[:, order])) for order in ([0, 1, 2, 3], [0, 3, 1, 2])
    )
    if name in POOLED:
        np.testing.assert_allclose(swapped, q, atol=1e-5)
    else:
        assert (np.abs(swapped - q).max(axis=1) > 1e-3).all()


@pytest.mark.parametrize("name", [name for name in NAMES if CHOICES[name]])
def test_a_row_without_a_vehicle_counts_for_nothing(name):
    rows, garbage = observations(), observations()
    garbage[:, -1, 1:] = 1e3
    q, other = (policy(name).q_values(flattened(one)) for one in (rows, garbage))
    np.testing.assert_array_equal(other, q)
    garbage[:, -1, 0] = 1.0  # a vehicle at that place would count
    assert (policy(name).q_values(flattened(garbage)) != q).any(axis=1).all()


@pytest.mark.parametrize("name", POOLED)
def test_more_empty_rows_change_nothing_in_a_pooled_view(name):
    drawn = encoding(jax.random.key(1), VEHICLES * ROW, name)
    assert drawn is not None
    view = drawn.in_numpy()
    rows = observations()
    np.testing.assert_allclose(view(flattened(rows[:, :-1])), view(flattened(rows)), atol=1e-6)


@pytest.mark.parametrize(
    ("ego", "other", "expected"),
    [
        # northward, at rest: (1, 2) is 2 ahead and 1 to the right; a vehicle that heads east
        # heads to the right
        ([0, 0, 0, 0, 0, 1], [1, 2, 3, 0, 1, 0], [2, -1, 0, -3, 0, -1]),
        # eastward at speed 2: what lies north lies to the left, and what stands comes closer
        ([1, 1, 2, 0, 1, 0], [1, 4, 0, 0, -1, 0], [0, 3, -2, 0, -1, 0]),
        # southward at speed 1 behind one of the same speed
        ([5, 5, 0, -1, 0, -1], [5, 2, 0, -1, 0, -1], [3, 0, 0, 0, 1, 0]),
    ],
)
def test_relative_columns_by_hand(ego, other, expected):
    found = of_others(RELATIVE, ego, other)
    np.testing.assert_allclose(found, [1, *other, *expected], atol=1e-12)


def test_the_scale_is_of_positions_and_velocities_not_of_headings():
    ego, other = [0.0, 0, 0, 0, 0, 1], [1.0, 2, 3, 0, 1, 0]
    view = View((), (), RELATIVE._replace(scale=5.0), 2 * ROW)
    found = view(np.array([1, 1, -2, 3, -4, 0.6, 0.8, *np.zeros(ROW)]))
    np.testing.assert_allclose(found[: ROW - 1], [5, -10, 15, -20, 0.6, 0.8])
    found = of_others(view.choice, ego, other)
    np.testing.assert_allclose(found, [1, 5, 10, 15, 0, 1, 0, 10, -5, 0, -15, 0, -1], atol=1e-12)


def test_relative_columns_do_not_change_when_the_scene_is_turned_and_shifted():
    rows = observations().astype(np.float64)
    cos, sin = np.cos(0.7), np.sin(0.7)
    turned = rows.copy()
    for first in (1, 3, 5):
        turned[..., first : first + 2] = rows[..., first : first + 2] @ [[cos, sin], [-sin, cos]]
    turned[..., 1:3] += [3.0, -2.0]
    view = View((), (), RELATIVE, VEHICLES * ROW)
    before, after = (
        view(flattened(one))[:, ROW - 1 :].reshape(len(rows), VEHICLES - 1, -1)
        for one in (rows, turned)
    )
    assert before.shape[-1] == ROW + 6
    np.testing.assert_allclose(after[..., ROW:], before[..., ROW:], atol=1e-12)
    assert (np.abs(after[:, :2, 1:ROW] - before[:, :2, 1:ROW]).max(axis=-1) > 0.1).all()


def test_closeness_is_of_the_moments_at_which_a_vehicle_is_near_the_ego():
    """It is 30 m ahead and comes 10 m nearer each second; 2.5 m beside, or 5 m."""
    place, motion = np.array([[0.3, 0.025], [0.3, 0.05]]), np.array([[-0.5, 0.0], [-0.5, 0.0]])
    found = closeness(place, motion)
    assert found.shape == (2, 2 * len(SECONDS))
    beside = 0.5  # 2.5 m of 5 m
    at = {2.0: 1 / 3, 2.5: 2 / 3, 3.0: 1.0, 3.5: 2 / 3, 4.0: 1 / 3}
    wanted = [beside * at.get(second, 0.0) for second in SECONDS]
    np.testing.assert_allclose(found[0, : len(SECONDS)], wanted, atol=1e-6)
    ahead = np.array([30 - 10 * second for second in SECONDS]) / 15
    np.testing.assert_allclose(found[0, len(SECONDS) :], wanted * ahead, atol=1e-6)
    np.testing.assert_allclose(found[1], 0.0, atol=1e-6)  # 5 m beside


def test_pooling_is_the_sum_and_the_greatest_of_every_vehicles_code():
    """One layer that keeps x, without a bias: x = 2, -1 and 3 become 2, 0 and 3."""
    keep_x = np.zeros((1, ROW))
    keep_x[0, 1] = 1.0
    view = View((keep_x,), (np.zeros(1),), Choice(True, False, 1.0), VEHICLES * ROW)
    rows = np.zeros((VEHICLES, ROW))
    rows[:, 0], rows[:, 1] = 1.0, [9, 2, -1, 3]
    np.testing.assert_array_equal(view(rows.ravel()), [9, 0, 0, 0, 0, 0, 5, 3])


@pytest.mark.parametrize("name", [name for name in NAMES if CHOICES[name]])
def test_the_width_is_what_the_view_returns(name):
    view = encoding(jax.random.key(0), VEHICLES * ROW, name)
    assert view is not None
    assert view.in_numpy()(flattened(observations())).shape == (6, view.width)


@pytest.mark.parametrize("name", NAMES)
def test_a_saved_policy_comes_back_with_its_view(name, tmp_path):
    made, path, seen = policy(name), tmp_path / "policy.safetensors", flattened(observations(40))
    made.save(path)
    loaded = QPolicy.load(path)
    assert loaded.n_features == made.n_features == VEHICLES * ROW
    choice: Any = loaded.view and loaded.view.choice
    assert choice == CHOICES[name]
    np.testing.assert_array_equal(loaded.q_values(seen), made.q_values(seen))
    np.testing.assert_array_equal(loaded.predict(seen)[0], made.predict(seen)[0])


def test_an_observation_of_another_length_is_refused_by_a_policy_with_a_view():
    with pytest.raises(UserError, match=r"this policy takes \(28,\)"):
        policy("set").predict(np.zeros(35))


@pytest.mark.parametrize(
    ("name", "n_features", "words"),
    [
        ("sets", 28, "^unknown view 'sets': choose one of flat, "),
        ("set", 6, "^view set reads rows of 7 .* this world's observation has 6: use the view fla"),
        ("flat_scaled", 7, "^view flat_scaled reads rows of 7 .* has 7: "),  # the ego alone
        ("set_relative", 15, "^view set_relative reads rows of 7 .* has 15: "),
    ],
)
def test_what_is_no_view_of_this_observation_is_refused(name, n_features, words):
    with pytest.raises(UserError, match=words) as caught:
        QNetwork.initialise(jax.random.key(0), n_features, (4,), 3, view=name)
    assert "\n" not in str(caught.value)


def test_the_flat_view_draws_what_a_network_without_views_drew(assert_same_leaves):
    key, sizes = jax.random.key(5), (6, 4, 3)
    keys = jax.random.split(key, 2)
    plain = [
        eqx.nn.Linear(inputs, outputs, key=one)
        for inputs, outputs, one in zip(sizes[:-1], sizes[1:], keys, strict=True)
    ]
    flat = QNetwork.initialise(key, 6, (4,), 3, view="flat")
    assert_same_leaves(flat, plain)
    assert_same_leaves(flat, QNetwork.initialise(key, 6, (4,), 3))


@pytest.fixture
def assert_same_leaves():
    def compare(one, other) -> None:
        for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
            np.testing.assert_array_equal(a, b)

    return compare


PLACES = OneHot.of(((0, 3), (-1, 2)))


@pytest.mark.parametrize("xp", [np, jnp])
def test_each_value_has_a_place_of_its_own(xp):
    rows = xp.asarray(np.array([[0, -1], [2, 0]], np.float32))
    expected = [[1, 0, 0, 1, 0], [0, 0, 1, 0, 1]]
    np.testing.assert_array_equal(PLACES(rows), expected)
    np.testing.assert_array_equal(PLACES(rows[0]), expected[0])
    assert (PLACES.n_features, PLACES.width) == (2, 5)


def test_a_value_outside_its_range_has_no_place():
    assert PLACES(np.array([7.0, 0.0], np.float32)).tolist() == [0, 0, 0, 0, 1]


def test_features_without_values_are_refused():
    with pytest.raises(UserError, match="one_hot needs"):
        OneHot.of(())
    with pytest.raises(UserError, match="one_hot needs"):
        OneHot.of(((0, 0),))


def test_a_policy_keeps_its_places_in_its_file(tmp_path):
    network = QNetwork(affine_layers(jax.random.key(0), (5, 8, 3)), "relu", PLACES)
    policy = QPolicy.of(network, 1.0, {})
    rows = np.array([[0, -1], [2, 0], [1, 0]], np.float32)
    np.testing.assert_allclose(policy.q_values(rows), jax.vmap(network)(rows), atol=1e-6)
    policy.save(tmp_path / "policy.safetensors")
    again = QPolicy.load(tmp_path / "policy.safetensors")
    assert again.n_features == 2
    np.testing.assert_array_equal(again.q_values(rows), policy.q_values(rows))


@pytest.mark.parametrize("times", [0, 4])
def test_only_vehicles_that_are_there_need_to_be_encoded(times):
    view = encoding(jax.random.key(2), 35 + bool(times), "set", times=times)
    assert view is not None
    random = np.random.default_rng(0)
    rows = random.normal(size=(60, 5, 7)).astype(np.float32)
    rows[:, 1:, 0] = random.random((60, 4)) < 0.4
    rows[:5, 1:] = 0.0  # alone on the road
    rows[..., 1:] *= rows[..., :1] > 0
    seen = rows.reshape(60, 35)
    if times:
        seen = np.column_stack([seen, np.arange(60, dtype=np.float32) % (times + 1)])
    found = PresentRows(view.in_numpy())(seen)
    np.testing.assert_allclose(found, view.in_numpy()(seen), atol=1e-5)
    np.testing.assert_allclose(PresentRows(view.in_numpy())(seen[:5]), found[:5], atol=1e-6)


@pytest.mark.parametrize("name", NAMES)
def test_a_clock_adds_a_place_for_each_time(name):
    if CHOICES[name] is None:
        return
    plain = encoding(jax.random.key(0), VEHICLES * ROW, name)
    clocked = encoding(jax.random.key(0), VEHICLES * ROW + 1, name, times=3)
    assert plain is not None and clocked is not None
    rows = flattened(observations(4))
    seen = clocked(np.column_stack([rows, np.array([0.0, 2.0, 1.0, 3.0], np.float32)]))
    assert clocked.width == plain.width + 3 == seen.shape[1]
    np.testing.assert_array_equal(seen[:, :3], np.eye(3)[[0, 2, 1, 0]] * [[1], [1], [1], [0]])
    np.testing.assert_allclose(seen[:, 3:], plain(rows), rtol=1e-6)


def test_a_policy_with_a_clock_is_read_as_it_was_written(tmp_path):
    seen = encoding(jax.random.key(0), VEHICLES * ROW + 1, "set", times=20)
    assert seen is not None
    layers = affine_layers(jax.random.key(1), (seen.width, 8, 3))
    clocked = QPolicy.of(QNetwork(layers, "relu", seen), 0.5, {})
    clocked.save(tmp_path / "policy.safetensors")
    again = QPolicy.load(tmp_path / "policy.safetensors")
    rows = np.column_stack([flattened(observations()), np.arange(6, dtype=np.float32)])
    np.testing.assert_array_equal(again.q_values(rows), clocked.q_values(rows))
    assert again.n_features == VEHICLES * ROW + 1
    with pytest.raises(UserError, match="reads rows of 7"):
        encoding(jax.random.key(0), VEHICLES * ROW, "set", times=20)


def route_observations(count: int = 40) -> np.ndarray:
    """Random observations along a route, of which each has fewer road users than the one before."""
    ego, user = ROUTE
    rng = np.random.default_rng(2)
    observation = rng.uniform(-1, 1, (count, ego + 5 * user)).astype(np.float32)
    users = observation[:, ego:].reshape(count, 5, user)
    present = np.arange(5) < 5 - np.arange(count)[:, None] % 6
    users[..., 0] = 1.0
    users *= present[..., None]
    return observation


@pytest.mark.parametrize("name", [name for name in NAMES if CHOICES[name]])
def test_a_view_of_the_route_reads_its_numbers_as_they_are(name: str, tmp_path: Path) -> None:
    observation = route_observations()
    drawn = QNetwork.initialise(jax.random.key(0), observation.shape[1], (8,), 3, view=name)
    policy = QPolicy.of(drawn, 0.5, {})
    view: Any = policy.view
    assert view.choice.layout == ROUTE
    q = policy.q_values(observation)
    np.testing.assert_allclose(np.asarray(jax.vmap(drawn)(observation)), q, atol=1e-5)
    np.testing.assert_array_equal(view(observation)[:, : ROUTE[0]], observation[:, : ROUTE[0]])
    if view.choice.pooled:
        reverse = observation.copy()
        users = reverse[:, ROUTE[0] :].reshape(len(reverse), 5, ROUTE[1])
        users[:] = users[:, ::-1].copy()
        np.testing.assert_allclose(policy.q_values(reverse), q, atol=1e-5)
        np.testing.assert_allclose(PresentRows(view)(observation), view(observation), atol=1e-5)
    policy.save(tmp_path / "route.safetensors")
    loaded: Any = QPolicy.load(tmp_path / "route.safetensors")
    assert loaded.view.choice == view.choice
    np.testing.assert_array_equal(loaded.q_values(observation), q)


def test_an_observation_of_no_layout_has_no_view() -> None:
    for length in (ROUTE[0] + ROUTE[1] + 1, ROUTE[0], ROW, 2 * ROW + 1):
        with pytest.raises(UserError, match="use the view flat"):
            encoding(jax.random.key(1), length, "set")
