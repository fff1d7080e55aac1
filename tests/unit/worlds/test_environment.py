"""Environments by name: code runs only where allowed, mistakes raise a one-line error."""

import gymnasium
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.worlds.environment import is_environment, make_environment, paired, sizes
from socialiq.worlds.wrapper import RewardPairWrapper

CODE = """
import pathlib
import gymnasium
import numpy as np
from socialiq.worlds.wrapper import RewardPairWrapper
pathlib.Path(__file__).with_suffix(".ran").touch()

class Road(gymnasium.Env):
    action_space = gymnasium.spaces.Discrete(2)
    observation_space = gymnasium.spaces.Box(0.0, 9.0, (2, 3), np.float32)

    def __init__(self, length=3, fails=False, render_mode=None):
        self.length, self.fails = length, fails

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.place = 0
        return self.observation_space.low.copy(), {}

    def step(self, action):
        if self.fails:
            raise ValueError("two\\nlines")
        self.place += 1
        seen = self.observation_space.low.copy()
        return seen, 1.0, self.place == self.length, False, {}

def make(length=3):
    return RewardPairWrapper(Road(length), lambda step: (step.reward, -1.0))

def number():
    return 3

gymnasium.register("roads/Road-v3", Road)
"""


@pytest.fixture(autouse=True)
def forget():
    yield
    gymnasium.registry.pop("roads/Road-v3", None)


@pytest.fixture
def road(tmp_path):
    (tmp_path / "a_road.py").write_text(CODE)
    return str(tmp_path / "a_road.py")


def lengths(env):
    env.reset(seed=0)
    steps = 1
    while not env.step(0)[2]:
        steps += 1
    return steps


@pytest.mark.parametrize("name", ["make", "Road", "roads/Road-v3"])
def test_functions_classes_and_ids_make_environments(road, name):
    env = make_environment(f"{road}:{name}", allow_code=True)
    seen, _ = env.reset(seed=0)
    assert seen.shape == (6,) and sizes(env) == (6, 2) and lengths(env) == 3
    assert (paired(env) is not None) == (name == "make")
    longer = make_environment(f"{road}:{name}", {"length": 5}, allow_code=True)
    assert lengths(longer) == 5


def test_a_module_may_be_named(road, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    assert lengths(make_environment("a_road:make", allow_code=True)) == 3


def test_code_runs_only_if_that_is_allowed(road, tmp_path):
    with pytest.raises(UserError, match=r"would run its author's code .* --allow-code"):
        make_environment(f"{road}:make")
    assert not (tmp_path / "a_road.ran").exists()


def test_a_pair_may_be_demanded(road):
    env = make_environment(f"{road}:Road", allow_code=True, needs_pair=True)
    assert isinstance(env, RewardPairWrapper)
    env.reset(seed=0)
    with pytest.raises(UserError, match="gives no reward pair"):
        env.step(0)


def test_built_in_and_registered_ones_need_no_code():
    built_in = make_environment("crossing7", needs_pair=True)
    built_in.reset(seed=0)
    assert built_in.step(1)[4]["reward_pair"].shape == (2,)
    assert sizes(make_environment("CartPole-v1")) == (4, 2)


@pytest.mark.parametrize(
    ("name", "options", "line"),
    [
        ("number", {}, "made int, not a gymnasium.Env"),
        ("nothing", {}, "has no function and registers no 'nothing'"),
        ("make", {"width": 1}, "raised TypeError: .*width"),
    ],
)
def test_what_makes_no_environment_is_told(road, name, options, line):
    with pytest.raises(UserError, match=line) as caught:
        make_environment(f"{road}:{name}", options, allow_code=True)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("Nowhere-v0", "unknown world 'Nowhere-v0': choose one of crossing5"),
        ("no such id", "unknown world 'no such id'"),
        ("no/such/file.py:make", "no such file"),
        ("no_such_module_here:make", "raised ModuleNotFoundError"),
        ("Pendulum-v1", "only discrete actions are supported, not Box"),
    ],
)
def test_unknown_names_are_told(name, line):
    with pytest.raises(UserError, match=line):
        make_environment(name, allow_code=True)


def test_a_failing_step_is_told_in_one_line(road):
    env = make_environment(f"{road}:Road", {"fails": True}, allow_code=True)
    env.reset(seed=0)
    with pytest.raises(UserError, match=r"a_road.py:Road raised ValueError: two lines; correct"):
        env.step(np.int64(0))


@pytest.mark.parametrize(
    ("name", "fits"),
    [
        ("merge-v0", True),
        ("highway_env:merge-v0", True),
        ("examples/merge.py:make", True),
        ("crossing7", False),
        ("moon", False),
        ("a b:make", False),
        ("a:b:c", False),
        ("a:make()", False),
    ],
)
def test_names_of_environments_have_a_form(name, fits):
    assert is_environment(name) == fits
