"""Code of the user's own in the place of ours: what it changes, and how its mistakes are told."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.learners.extensions import checked_divergence, checked_prior, load
from socialiq.learners.iq_learn.config import IQLearnConfig, IQLearnHyperparameters
from socialiq.learners.iq_learn.losses import DIVERGENCES
from socialiq.learners.iq_learn.train import train
from socialiq.learners.kernel import Learner
from socialiq.learners.kernel import LearnerHyperparameters as Numbers

pytestmark = pytest.mark.usefixtures("quick_compiler")
OFFLINE = IQLearnConfig(
    hidden=(8,), batch_size=8, updates=20, online=False, value_term="value_expert"
)
RUNS = [IQLearnHyperparameters(angle=45.0), IQLearnHyperparameters(angle=45.0, strength=2.0)]


def quadratic(reward: Any, target: Any, strength: Any) -> Any:
    return jnp.mean(jnp.square(reward - strength * target))


def l1(reward: Any, target: Any, strength: Any) -> Any:
    return jnp.mean(jnp.abs(reward - strength * target))


def test_the_thesis_prior_as_ones_own_trains_to_the_same_bits(data, assert_same):
    ours, own = train(OFFLINE, RUNS, [data]), train(OFFLINE, RUNS, [data], prior=quadratic)
    assert_same(own.networks, ours.networks)
    assert_same(own.history.values, ours.history.values)
    assert own.policy(0).provenance["own_prior"]["name"] == "quadratic"
    assert "own_prior" not in ours.policy(0).provenance


def test_another_prior_trains_another_network_by_its_own_value(data):
    still = [dataclasses.replace(one, learning_rate=1e-30, prior_weight=3.0) for one in RUNS]
    trained, squared = train(OFFLINE, still, [data], prior=l1), train(OFFLINE, still, [data])
    assert (trained.history.array("expert") == squared.history.array("expert")).all()
    assert (trained.history.array("prior") != squared.history.array("prior")).all()
    other = train(OFFLINE, RUNS, [data], prior=l1)
    plain = train(OFFLINE, RUNS, [data])
    gap = other.policy(0).weights[0] - plain.policy(0).weights[0]
    assert np.abs(gap).max() > 1e-5


@pytest.mark.parametrize("name", ["kl"])
def test_a_known_divergence_as_ones_own_trains_alike(data, name):
    """Its slope is derived; the floor is not met here."""
    static = dataclasses.replace(OFFLINE, divergence=name)
    ours = train(static, RUNS, [data])
    own = train(OFFLINE, RUNS, [data], divergence=DIVERGENCES[name].phi)
    assert "chi2" not in own.history.values
    for run in (0, 1):
        np.testing.assert_allclose(
            own.policy(run).weights[0], ours.policy(run).weights[0], atol=1e-5
        )


@pytest.mark.slow
def test_a_loss_of_ones_own_names_its_terms(data):
    def pull(network: Any, target_network: Any, batches: Any, hyperparameters: Any, static: Any):
        size = sum(jnp.sum(leaf**2) for leaf in jax.tree.leaves(network))
        return size, {"size": size, "loss": size}

    static = dataclasses.replace(OFFLINE, updates=400)
    fast = [dataclasses.replace(RUNS[0], learning_rate=0.01)]
    trained = train(static, fast, [data], loss=pull, chunk=100)
    assert set(trained.history.values) == {"size", "loss"}
    assert np.abs(trained.policy(0).weights[0]).max() < 1e-2


class Cloner(Learner):
    """The least learner: cross-entropy on the demonstrations."""

    def loss(self, network, target_network, batch, hyperparameters):
        logits = jax.nn.log_softmax(jax.vmap(network)(batch.observation))
        loss = -jnp.mean(jnp.take_along_axis(logits, batch.action[:, None], axis=1))
        return loss, {"loss": loss}


def test_a_learner_of_ones_own_learns_and_resumes_under_its_own_fingerprint(data):
    shape = Cloner.StaticConfig(hidden=(32,), batch_size=32, updates=400)
    runs = [Numbers(learning_rate=0.03, seed=seed) for seed in (0, 1)]
    trained = train(shape, runs, [data], learner=Cloner, chunk=100)  # pyright: ignore
    assert trained.failures == ()
    loss = trained.history.array("loss")
    assert (loss[-1] < 0.8 * loss[0]).all()
    agreed = trained.policy(1).predict(data.observation)[0] == data.action
    assert agreed.mean() > 0.6
    assert trained.policy(0).provenance["own_learner"]["name"] == "Cloner"


class Broken(Cloner):
    def loss(self, network, target_network, batch, hyperparameters):
        loss, _ = super().loss(network, target_network, batch, hyperparameters)
        return loss, {"loss": loss, "rows": batch.action}


@pytest.mark.usefixtures("as_a_user_runs_it")
@pytest.mark.parametrize(
    ("own", "mend"),
    [
        ({"prior": lambda r, t, s: r - s * t}, "must return a scalar, got float32[8]"),
        ({"prior": lambda r, t, s: 3}, "must return a scalar, got int32[]"),
        ({"prior": lambda r, t, s: jnp.mean(jnp.log(r))}, "its value is not finite"),
        ({"prior": lambda r, t, s: jnp.mean(jnp.sqrt(0.0 * r))}, "its slope is not finite"),
        ({"prior": lambda r, t: 0.0}, "raised TypeError"),
        ({"divergence": jnp.mean}, "must return one value for each reward"),
        ({"divergence": jnp.log}, "its value is not finite"),
        ({"divergence": "tv"}, "must be a function φ of rewards"),
        ({"loss": lambda *given: (jnp.ones(3), {})}, "raised TypeError"),
        ({"loss": lambda *given: (jnp.float32(1.0), {"a": jnp.float32(1.0)})}, "with 'loss' among"),
        ({"learner": Broken}, "term 'rows' must be a scalar"),
        ({"learner": l1}, "must be a class that derives from"),
        ({"learner": Cloner, "prior": l1}, "takes no world, prior"),
    ],
)
def test_mistakes_are_one_line_before_training(data, own, mend):
    static = Cloner.StaticConfig(updates=5) if "learner" in own else OFFLINE
    runs = [Numbers()] if "learner" in own else RUNS
    with pytest.raises(UserError) as caught:
        train(static, runs, [data], **own)  # pyright: ignore
    assert mend in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_prior_that_breaks_later_stops_its_run_alone(data):
    def fragile(reward: Any, target: Any, strength: Any) -> Any:
        return l1(reward, target, strength) + jnp.where(strength > 1.5, jnp.inf, 0.0)

    trained = train(OFFLINE, RUNS, [data], prior=fragile)
    (line,) = trained.failures
    assert line.startswith("angle 45, strength 2, seed 0 stopped at update 0: prior not finite")


def test_a_prior_of_ones_own_needs_the_setting_it_replaces(data):
    with pytest.raises(UserError, match="replaces --prior reward"):
        train(dataclasses.replace(OFFLINE, prior="none"), RUNS, [data], prior=l1)


def test_what_is_named_is_imported_only_where_code_may_run(tmp_path):
    file = tmp_path / "mine.py"
    lines = ["import jax.numpy as jnp", "def l1(r, t, s):", "    return jnp.mean(abs(r - s * t))"]
    file.write_text("\n".join(lines))
    place = f"{file}:l1"
    assert checked_prior(load(place, "--prior", True))(jnp.ones(2), jnp.ones(2), 1.0) == 0.0
    broken = tmp_path / "broken.py"
    broken.write_text("1 / 0")
    refused = {
        "allow that with --allow-code": (place, False),
        "is no FILE.py:NAME": ("mine:l1", True),
        "no such file": (f"{tmp_path}/other.py:l1", True),
        "has no 'l2'": (f"{file}:l2", True),
        "raised ZeroDivisionError": (f"{broken}:l1", True),
    }
    for mend, (name, allowed) in refused.items():
        with pytest.raises(UserError) as caught:
            load(name, "--prior", allowed)
        assert mend in str(caught.value)
        assert "\n" not in str(caught.value)


def test_the_slope_of_a_divergence_is_derived_element_by_element():
    found = checked_divergence(lambda x: -jnp.exp(-x - 1))
    rewards = jnp.linspace(-1.0, 2.0, 5)
    np.testing.assert_allclose(found.slope(rewards), DIVERGENCES["kl"].slope(rewards), rtol=1e-5)
