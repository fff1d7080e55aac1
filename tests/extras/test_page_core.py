"""The core as WebAssembly beside the native one; Node runs it."""

import json
import shutil

import numpy as np
import pytest
from tests.page_core import equality
from tests.page_core.equality import compared, in_node, native
from tests.page_core.people import driven

from socialiq.cli.main import main
from socialiq.nn.dial_policy import DialPolicy
from socialiq.page.people import EPISODE
from socialiq.page.webassembly import build
from socialiq.page.webassembly.layout import CORE
from socialiq.storage import packaged_results, read_json
from socialiq.worlds.intersection.options import FleetOptions, Options
from socialiq.worlds.intersection.policies import policy
from socialiq.worlds.registry import make

pytestmark = pytest.mark.skipif(not shutil.which("node"), reason="Node.js is not installed")

SEEDS = np.arange(50_000_000, 50_000_060)


@pytest.mark.parametrize("name", ["dial", "random"])
def test_episodes_are_the_same(name):
    dial = DialPolicy.load(packaged_results() / equality.DIAL).at(45.0)
    driver = dial if name == "dial" else policy(name)
    mine = native(Options(), SEEDS, driver)
    found = compared(
        mine, in_node(Options(), SEEDS, mine.actions), dial if name == "dial" else None
    )
    assert found.same_endings == len(SEEDS)
    assert found.same_decisions == found.decisions
    assert found.equal_observations >= 0.97 * found.observations
    assert found.close_states >= 0.95 * found.observations


def test_options_reach_it():
    options = Options(destination="random", population="thesis", spawn_probability=0.9)
    mine = native(options, SEEDS[:20], policy("gap_2s"))
    found = compared(mine, in_node(options, SEEDS[:20], mine.actions))
    assert found.same_endings == 20
    assert found.close_states >= 0.9 * found.observations


def test_people_are_the_same_and_the_shown_episode_is_that_of_the_dial():
    options, shown = (
        make("intersection", people=0.1, cyclists=0.1).options,
        read_json(packaged_results() / EPISODE),
    )
    mine = native(options, SEEDS, policy("gap_3s"))
    theirs = in_node(options, SEEDS, mine.actions)
    found = compared(mine, theirs)
    assert found.same_endings == len(SEEDS)
    assert found.equal_observations >= 0.95 * found.observations
    assert len(np.unique(theirs.arrays["people"]["state"])) == 4
    for driver in shown["drivers"]:
        actions, waited, _ = driven(driver["class_angle"], np.array([shown["seed"]]))
        assert actions[:, 0].tolist() == driver["actions"]
        people = in_node(options, np.array([shown["seed"]]), actions).arrays["people"][-1, 0]
        assert people["delay"][people["kind"] == 0].sum() == pytest.approx(waited[0])


@pytest.mark.parametrize("name", ["gap_3s", "random"])
def test_fleets_are_the_same(name):
    options = FleetOptions(agents=8, spawn_probability=0.6, duration=30.0)
    mine = native(options, SEEDS[:20], policy(name))
    found = compared(
        mine, in_node(options, SEEDS[:20], mine.actions), policy(name) if name != "random" else None
    )
    assert mine.actions.shape[1:] == (20, 8) and len({*mine.arrays["ending"][-1].tolist()}) > 1
    assert found.same_endings == found.episodes == 160
    assert found.same_decisions == found.decisions
    assert found.equal_observations >= 0.95 * found.observations
    assert found.close_states >= 0.9 * found.observations


@pytest.mark.slow
def test_a_core_built_again_behaves_as_the_one_that_ships(tmp_path):
    pytest.importorskip("ziglang", reason="extra `page` is not installed")
    build.object_file(tmp_path / "core.o")
    build.linked(tmp_path / "core.o", tmp_path / "core.wasm")
    actions = np.random.default_rng(0).integers(3, size=(8, len(SEEDS)))
    shipped = in_node(Options(), SEEDS, actions, CORE)
    again = in_node(Options(), SEEDS, actions, tmp_path / "core.wasm")
    for name, array in shipped.arrays.items():
        if array.dtype.names is None:
            np.testing.assert_array_equal(array, again.arrays[name], name)
    found = compared(shipped, again)
    assert found.equal_states == found.observations


def test_the_committed_counts_are_those_of_the_command():
    config = equality.Comparison(packaged_results())
    for path in (packaged_results() / "page-core" / name for name in ("machine.json", "page.json")):
        found = read_json(path)
        assert (found["episodes"], found["first"]) == (config.episodes, config.first)
        assert found["all"]["episodes"] == config.episodes * len(found["drivers"])


def test_its_speed_is_measured_beside_the_native_core(capsys):
    assert main(["bench", "page", "--repeats", "1", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["ratio"] > 0 and found["bytes"] == CORE.stat().st_size
    if "pictures_per_s" in found:  # where Chromium and the extra `browser` are installed
        times = ("first_picture_ms", "first_scene_ms", "ms_per_degree", "ms_of_500_episodes")
        assert all(found[name] > 0 for name in (*times, "pictures_per_s"))
