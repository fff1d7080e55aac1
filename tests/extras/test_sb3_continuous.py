"""Policies of Stable-Baselines3 with continuous actions act here as they do there."""

from pathlib import Path

import gymnasium
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.evaluation.rollout import rollout_env
from socialiq.policies.load import load_policy
from socialiq.worlds.environment import make_environment

sb3 = pytest.importorskip("stable_baselines3", reason="extra `sb3` is not installed")


@pytest.mark.parametrize("algorithm", ["SAC", "TD3", "DDPG", "PPO", "A2C"])
def test_its_actions_are_theirs_in_units_of_the_bounds(algorithm: str, tmp_path: Path) -> None:
    kind, file = getattr(sb3, algorithm), tmp_path / "policy.zip"
    model = kind(
        "MlpPolicy", "Pendulum-v1", policy_kwargs={"net_arch": [8, 8]}, seed=0, device="cpu"
    )
    model.save(file)
    env = gymnasium.make("Pendulum-v1")
    seen = np.stack([env.observation_space.sample() for _ in range(200)])
    loaded = load_policy(str(file), 3, 0, action_size=1)
    ours = loaded.policy.predict(seen)[0]
    np.testing.assert_allclose(2.0 * ours, model.predict(seen, deterministic=True)[0], atol=1e-5)
    drawn = loaded.policy.predict(np.repeat(seen[:1], 4000, axis=0), deterministic=False)[0]
    theirs = model.predict(np.repeat(seen[:1], 4000, axis=0), deterministic=False)[0]
    assert 2.0 * drawn.std() == pytest.approx(theirs.std(), rel=0.06, abs=1e-6)
    made = make_environment("Pendulum-v1", continuous=True)
    assert rollout_env(made, loaded.policy, 1, seed=0).transitions.n_transitions == 200
    with pytest.raises(UserError, match="takes 3 features and actions of 1 numbers"):
        load_policy(str(file), 3, 0, action_size=2)
