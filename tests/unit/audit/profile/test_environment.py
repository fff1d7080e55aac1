"""An environment as the scenario of an audit: who it is, and who drove how in it."""

import gymnasium
import numpy as np
import pytest

from socialiq.audit.evidence.collect import collect_evidence
from socialiq.audit.evidence.drive import Course
from socialiq.audit.evidence.outcomes import Reference
from socialiq.audit.profile import environment
from socialiq.audit.profile.environment import Environment
from socialiq.audit.profile.profile import Margin, identity, world_of
from socialiq.audit.profile.reader import parse
from socialiq.audit.profile.template import declare
from socialiq.audit.report.content import limits
from socialiq.errors import UserError
from socialiq.types import Ending

CODE = """
import gymnasium
import numpy as np
from socialiq.worlds.wrapper import RewardPairWrapper

class Road(gymnasium.Env):
    \"\"\"Ends after 3 steps; action 1 strikes at once. The start is drawn.\"\"\"

    action_space = gymnasium.spaces.Discrete(2)
    observation_space = gymnasium.spaces.Box(0.0, 9.0, (2,), np.float32)

    def __init__(self, forgets=False):
        self.forgets = forgets

    def reset(self, *, seed=None, options=None):
        super().reset(seed=None if self.forgets else seed)
        # Draws that forget their seed must not agree by chance.
        starts = 2**20 if self.forgets else 3
        self.start, self.time = self.np_random.integers(starts), 0
        return np.array([self.start, self.time], np.float32), {}

    def step(self, action):
        self.time += 1
        info = {"ending": "collision" if action else "arrival"}
        seen = np.array([self.start, self.time], np.float32)
        return seen, 0.0, bool(action) or self.time == 3, False, info

def make(forgets=False, far=1.0):
    return RewardPairWrapper(Road(forgets), lambda step: (far + step.observation[0], -step.action))
"""


class Policy:
    def __init__(self, action):
        self.action = action

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.array(self.action), state


class Coin:
    """Soft: draws an action."""

    def probabilities(self, observations):
        return np.full((len(observations), 2), 0.5)

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.array(0), state


@pytest.fixture
def name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "audited_road.py").write_text(CODE)
    return "audited_road.py:make"


@pytest.fixture
def world(name):
    return Environment.of(name, {}, allow_code=True)


SEEDS = np.array([5, 2**40 + 1, 7])


def test_what_everybody_earned_is_summed(world):
    went = Course(world, SEEDS).drive(Reference("goes", Policy(0), 45.0))
    starts = [world.env.reset(seed=seed % 2**31)[0][0] for seed in SEEDS.tolist()]
    assert went.totals.tolist() == [[3 * (1 + start), 0.0] for start in starts]
    assert len(set(starts)) > 1
    assert went.episodes.length.tolist() == [3, 3, 3] and set(went.episodes.ending) == {
        Ending.ARRIVAL
    }
    assert went.angles == (45.0,) and not went.episodes.at_fault.any()
    struck = Course(world, SEEDS).drive(Reference("strikes", Policy(1)))
    assert struck.episodes.at_fault.all() and not struck.episodes.struck.any()
    assert struck.episodes.length.tolist() == [1, 1, 1] and (struck.totals[:, 1] == -1).all()


def test_a_soft_policy_draws_by_the_episode(world):
    coin = Reference("coin", Coin())
    assert Course(world, SEEDS).drive(coin).episodes.length.tolist() == [3, 3, 3]
    seeds = np.arange(40)
    drawn = Course(world, seeds).drive(coin, deterministic=False)
    again = Course(world, seeds[::-1].copy()).drive(coin, deterministic=False)
    assert drawn.episodes.length.tolist() == again.episodes.length[::-1].tolist()
    assert set(drawn.episodes.length.tolist()) == {1, 2, 3}


def test_evidence_needs_a_driver_to_compare_with(world):
    with pytest.raises(UserError, match="at least one reference driver"):
        collect_evidence(world, Policy(0), SEEDS)
    found = collect_evidence(world, Policy(1), SEEDS, [Reference("goes", Policy(0))])
    assert found.strata == {} and found.scenario == world.description
    assert [one.name for one in found.references] == ["goes"]


def test_an_environment_that_forgets_its_seed_is_refused(name):
    forgets = Environment.of(name, {"forgets": True}, allow_code=True)
    with pytest.raises(UserError, match="is not determined by its seed"):
        collect_evidence(forgets, Policy(0), np.arange(5), [Reference("goes", Policy(1))])


def test_options_and_every_byte_of_the_source_are_the_scenario(name, tmp_path):
    plain = identity(world_of(name, {}, allow_code=True))
    assert plain == identity(world_of(name, {}, allow_code=True))
    far = identity(world_of(name, {"far": 2.0}, allow_code=True))
    assert far["scenario.sha256"] != plain["scenario.sha256"]
    (tmp_path / "audited_road.py").write_text(CODE + "# changed\n")
    changed = identity(world_of(name, {}, allow_code=True))
    assert changed["scenario.sha256"] != plain["scenario.sha256"]
    assert changed["reward.sha256"] != plain["reward.sha256"]
    assert plain["reward.id"] == f"environment/{name}"


def test_a_registered_environment_is_known_by_its_package(monkeypatch):
    monkeypatch.setattr(environment, "_OWN", ("socialiq",))
    world = Environment.of("CartPole-v1", {}, allow_code=False)
    assert '"gymnasium.envs.classic_control.cartpole"' in world.description
    assert f'"gymnasium":"{gymnasium.__version__}"' in world.description
    assert '"max_episode_steps":500' in world.description


def declared(name, day, **more):
    return declare(45.0, "An owner", name, Margin(0.5, 10.0), day, allow_code=True, **more)


@pytest.fixture
def day():
    import datetime

    return datetime.date(2026, 1, 31)


def test_a_declaration_is_read_without_running_code(name, day, tmp_path):
    profile = declared(name, day, options={"far": 2.5})
    (tmp_path / "audited_road.py").write_text("raise SystemExit")
    read = parse(profile.source)
    assert read == profile and read.scenario.options == {"far": 2.5}
    with pytest.raises(UserError, match="would run its author's code"):
        read.world()


def test_only_the_declared_environment_will_do(name, day, tmp_path):
    profile = declared(name, day)
    assert profile.world(allow_code=True).n_features == 2
    (tmp_path / "audited_road.py").write_text(CODE.replace("== 3", "== 4"))
    with pytest.raises(UserError, match=r"reward.sha256 is of another world"):
        profile.world(allow_code=True)


@pytest.mark.parametrize("given", [{"a": {"b": 1}}, {"a": ["x"]}, {"a": 1e9}, {"a": "x" * 300}])
def test_options_are_plain(name, day, given):
    with pytest.raises(UserError, match=r"^a must"):
        declared(name, day, options=given)


def test_built_in_worlds_go_by_their_own_name(day):
    with pytest.raises(UserError, match="is the id of an environment: declare the world crossing7"):
        declared("socialiq/Crossing7-v1", day)


def test_the_report_says_what_is_not_known(name):
    assert any("does not report fault" in one for one in limits(name))
    assert not any("does not report fault" in one for one in limits("intersection"))
    assert "exact optima" in limits("crossing7")[0]
