"""Roads with several agents behind PettingZoo's interface, by its own tests and its wrappers."""

import runpy
import warnings
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pettingzoo", reason="extra `pettingzoo` is not installed")

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # of its own games, which it imports
    from pettingzoo.test import parallel_api_test, parallel_seed_test

from socialiq.errors import UserError
from socialiq.worlds.intersection.options import MULTI_AGENT
from socialiq.worlds.parallel import RoadParallelEnv
from socialiq.worlds.registry import make_fleet

EXAMPLE = Path(__file__).parents[2] / "examples" / "policies" / "train_fleet.py"
GO = 2


@pytest.mark.parametrize(
    "arguments",
    [
        {},
        {"agents": 4, "angle": [0.0, 30.0, 45.0, 90.0], "clock": True},
        {"agents": 4, **MULTI_AGENT},
        {"name": "merge", "agents": 5},
    ],
)
def test_pettingzoos_own_tests_pass(arguments):
    parallel_api_test(RoadParallelEnv(**arguments), num_cycles=300)
    parallel_seed_test(lambda: RoadParallelEnv(**arguments))


def test_agents_have_their_own_pair_and_the_reward_of_their_angle():
    env, batch = RoadParallelEnv(agents=3, angle=[0.0, 45.0, 90.0]), make_fleet(agents=3).batch(1)
    seen, _ = env.reset(seed=7)
    np.testing.assert_array_equal(np.stack(list(seen.values()))[None], batch.reset([7]))
    while env.agents:
        agents = env.agents
        seen, rewards, terminated, truncated, infos = env.step(dict.fromkeys(agents, GO))
        made = batch.step(np.full((1, 3), GO), auto_reset=False)
        assert list(rewards) == list(infos) == list(terminated) == agents
        for agent in agents:
            number = int(agent[-1])
            pair = np.array(made.rewards)[:, 0, number]
            np.testing.assert_array_equal(infos[agent]["reward_pair"], pair)
            mixed = [pair[0], pair.sum() / np.sqrt(2), pair[1]][number]
            assert rewards[agent] == pytest.approx(mixed, abs=1e-12)
            np.testing.assert_array_equal(seen[agent], made.observation[0, number])
            ending = infos[agent]["ending"]
            assert terminated[agent] == (ending in ("arrival", "collision"))
            assert truncated[agent] == (ending == "timeout")
            assert (agent in env.agents) == (ending == "none")
    assert not batch.running.any()


def test_agents_of_joint_episodes_leave_together():
    env = RoadParallelEnv(agents=4, **MULTI_AGENT)
    for seed in range(10):
        env.reset(seed=seed)
        while env.agents:
            *_, terminated, truncated, _ = env.step(dict.fromkeys(env.agents, GO))
            left = [terminated[agent] or truncated[agent] for agent in terminated]
            assert len(left) == 4 and len({*left}) == 1


def test_mistakes_are_one_line():
    with pytest.raises(UserError, match="angle must be one number, or 2 of them, got 3"):
        RoadParallelEnv(angle=[0.0, 1.0, 2.0])
    env = RoadParallelEnv()
    env.reset(seed=0)
    with pytest.raises(UserError, match="the action of agent_1 is missing"):
        env.step({"agent_0": GO})
    for wrong in (float("nan"), 1.5, "faster", [0, 1]):
        with pytest.raises(UserError, match="the action of agent_1 must be a whole number"):
            env.step({"agent_0": GO, "agent_1": wrong})
    with pytest.raises(UserError, match="actions must be 0 to 2"):
        env.step({"agent_0": GO, "agent_1": 7})


def test_the_example_trains_a_policy_that_drives_every_agent(tmp_path, capsys):
    pytest.importorskip("stable_baselines3", reason="extra `sb3` is not installed")
    pytest.importorskip("supersuit", reason="extra `pettingzoo` is not installed")
    runpy.run_path(str(EXAMPLE))["main"](str(tmp_path / "fleet.zip"), 2048)
    printed = capsys.readouterr().out.splitlines()
    assert [line.partition(":")[0] for line in printed] == ["arrival", "collision", "timeout"]
    assert sum(float(line.split()[1]) for line in printed) == pytest.approx(100, abs=0.2)
