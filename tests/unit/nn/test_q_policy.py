import jax
import numpy as np
import pytest
from scipy.special import softmax

from socialiq.errors import UserError
from socialiq.nn.q_network import QNetwork
from socialiq.nn.q_policy import QPolicy
from socialiq.storage import save_arrays
from socialiq.types import Policy

OBSERVATIONS = np.random.default_rng(0).normal(size=(50, 4)).astype(np.float32) * 3


def network(activation: str = "relu") -> QNetwork:
    return QNetwork.initialise(jax.random.key(0), 4, (16, 8), 3, activation)


def bandit(*q: float, temperature: float = 1.0, seed: int = 0) -> QPolicy:
    """A policy whose Q is the same in every state."""
    values = np.array(q, np.float32)
    rng = np.random.default_rng(seed)
    return QPolicy((np.zeros((len(q), 1), np.float32),), (values,), "relu", temperature, {}, rng)


@pytest.fixture(name="policy")
def some_policy():
    return QPolicy.of(network(), 0.5, {"learner": "test", "numbers": [1, 2.5]})


@pytest.mark.parametrize("activation", ["relu", "elu"])
def test_numpy_forward_equals_the_jax_network(activation):
    jax_network = network(activation)
    policy = QPolicy.of(jax_network, 1.0, {})
    expected = jax.vmap(jax_network)(OBSERVATIONS)
    np.testing.assert_allclose(policy.q_values(OBSERVATIONS), expected, atol=1e-5)


def test_sizes_are_those_of_the_network(policy):
    assert (policy.n_features, policy.n_actions) == (4, 3)


def test_probabilities_are_the_softmax_at_the_temperature():
    found = bandit(0.0, 2 * np.log(3), temperature=2.0).probabilities(np.zeros((1, 1)))
    np.testing.assert_allclose(found, [[0.25, 0.75]], rtol=1e-6)


def test_predict_has_the_form_of_stable_baselines(policy):
    assert isinstance(policy, Policy)
    memory = object()
    actions, state = policy.predict(OBSERVATIONS, memory, np.zeros(50, bool), True)
    assert actions.shape == (50,)
    assert np.issubdtype(actions.dtype, np.integer)
    assert state is memory
    action, state = policy.predict(OBSERVATIONS[7])
    assert isinstance(action, np.ndarray)
    assert action.shape == ()
    assert action == actions[7]
    assert state is None


def test_deterministic_takes_the_first_of_the_greatest():
    action, _ = bandit(1.0, 3.0, 3.0).predict(np.zeros(1))
    assert action == 1


@pytest.mark.parametrize("deterministic", [True, False])
def test_a_batch_of_one_stays_a_batch(policy, deterministic):
    actions, _ = policy.predict(OBSERVATIONS[:1], deterministic=deterministic)
    assert actions.shape == (1,)


def test_stochastic_frequencies_are_the_probabilities():
    q, draws = [0.0, 1.0, -0.5], 40_000
    actions, _ = bandit(*q, temperature=0.7).predict(np.zeros((draws, 1)), deterministic=False)
    expected = softmax(np.array(q) / 0.7)
    error = np.abs(np.bincount(actions) / draws - expected)
    assert (error < 4 * np.sqrt(expected * (1 - expected) / draws)).all()


def test_draws_come_from_the_given_generator():
    many = np.zeros((200, 1))
    first, again, other = (
        bandit(0.0, 0.0, seed=seed).predict(many, deterministic=False)[0] for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()


def test_an_action_without_probability_is_never_drawn():
    policy = bandit(0.0, 1000.0, 0.0, temperature=0.01)
    actions, _ = policy.predict(np.zeros((2000, 1)), deterministic=False)
    assert (actions == 1).all()


@pytest.mark.parametrize(
    ("observation", "words"),
    [
        (np.zeros(3), r"observation of shape \(3,\): this policy takes \(4,\)"),
        (np.zeros((2, 5)), "this policy takes"),
        (np.zeros((2, 2, 4)), "this policy takes"),
        (np.array([0, np.nan, 0, 0]), "NaN or infinity"),
        (np.array([0, np.inf, 0, 0]), "NaN or infinity"),
    ],
)
@pytest.mark.parametrize("deterministic", [True, False])
@pytest.mark.usefixtures("as_a_user_runs_it")
def test_a_bad_observation_is_refused_in_one_line(policy, observation, words, deterministic):
    with pytest.raises(UserError, match=words) as caught:
        policy.predict(observation, deterministic=deterministic)
    assert "\n" not in str(caught.value)


def test_a_saved_policy_comes_back(policy, tmp_path):
    path = tmp_path / "policy.safetensors"
    sha256 = policy.save(path)
    loaded = QPolicy.load(path)
    np.testing.assert_array_equal(loaded.q_values(OBSERVATIONS), policy.q_values(OBSERVATIONS))
    assert (loaded.temperature, loaded.activation) == (0.5, "relu")
    assert loaded.provenance == {"learner": "test", "numbers": [1, 2.5]}
    assert loaded.save(tmp_path / "again.safetensors") == sha256


def test_a_damaged_or_foreign_file_is_refused(policy, tmp_path):
    path = tmp_path / "policy.safetensors"
    policy.save(path)
    whole = path.read_bytes()
    for damaged in (whole[:-1], whole[:-9] + bytes([whole[-9] ^ 1]) + whole[-8:], b""):
        path.write_bytes(damaged)
        with pytest.raises(UserError, match="damaged"):
            QPolicy.load(path)
    save_arrays(path, "demonstrations", 1, {"x": np.zeros(1)}, {})
    with pytest.raises(UserError, match="holds demonstrations, not policy"):
        QPolicy.load(path)
    with pytest.raises(UserError, match="no such file"):
        QPolicy.load(tmp_path / "absent")
