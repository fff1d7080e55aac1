"""The page's scripts beside the package: its network decides alike, its files are ours."""

import json
import shutil
import subprocess
from pathlib import Path

import jax
import numpy as np
import pytest
from tests.page_core.equality import native
from tests.page_core.fleets import chosen_cars

from socialiq.cli.main import main
from socialiq.demonstrations import files
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.dial_policy import DialPolicy
from socialiq.page.data import CAUSED_STUDY, FAMILY, STORY_SEED, STUDY, shipped_dial
from socialiq.page.fleets import DIALS, OPTIONS
from socialiq.page.webassembly.layout import CORE, layout
from socialiq.population.fleet import drive
from socialiq.storage import packaged_results
from socialiq.types import Ending
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Intersection

pytestmark = pytest.mark.skipif(not shutil.which("node"), reason="Node.js is not installed")

HERE = Path(__file__).parent
DIAL_FILE = packaged_results() / STUDY / f"{FAMILY}.safetensors"


def node(script, *words):
    subprocess.run(["node", str(HERE / script), *map(str, words)], check=True)


def seen_by(dial, angle, episodes):
    """All that the dial at an angle observes in some episodes that it drives."""
    batch, policy = Intersection().batch(episodes), dial.at(angle)
    batch.reset(np.arange(50_000_000, 50_000_000 + episodes))
    alive, seen = np.ones(episodes, bool), []
    while alive.any():
        now = batch.seen_by(policy)
        seen.append(now[alive])
        chosen = policy.predict(now, deterministic=True)[0]
        ending = batch.step(chosen, auto_reset=False, rows=alive).ending
        alive &= ending == Ending.NONE
    return np.concatenate(seen)


def answers(path, angle, seen, folder):
    """Decisions, then values, of the page and of the package on some observations."""
    (folder / "seen.bin").write_bytes(seen.astype("<f4").tobytes())
    files = path, folder / "seen.bin", angle, seen.shape[1], folder / "answers.bin"
    node("page_network.mjs", *files)
    theirs = np.fromfile(folder / "answers.bin").reshape(len(seen), -1)
    policy = DialPolicy.load(path).at(angle)
    ours = policy.predict(seen, deterministic=True)[0]
    return (theirs[:, 0], ours), (theirs[:, 1:], policy.q_values(seen))


def test_the_networks_decide_alike(tmp_path):
    seen = seen_by(DialPolicy.load(DIAL_FILE), 45.0, 60)
    (theirs, ours), _ = answers(DIAL_FILE, 45.0, seen, tmp_path)
    assert len(ours) > 500 and len(set(ours.tolist())) == 3
    np.testing.assert_array_equal(theirs, ours)


@pytest.mark.slow
def test_the_networks_decide_alike_on_100000_observations(tmp_path):
    dial, count = DialPolicy.load(DIAL_FILE), 0
    for angle in np.arange(0.0, 91.0, 15.0).tolist():
        (theirs, ours), _ = answers(DIAL_FILE, angle, seen_by(dial, angle, 1_150), tmp_path)
        assert (theirs != ours).sum() == 0, angle
        count += len(ours)
    assert count >= 100_000


KINDS = [
    ("flat", 0, False, (), "relu"),
    ("flat", 20, True, (), "elu"),
    ("flat_relative_scaled", 20, False, (0.0, 45.0, 90.0), "relu"),
    ("set_absolute", 0, True, (), "elu"),
    ("set", 20, True, (0.0, 45.0, 90.0), "relu"),
]


@pytest.mark.parametrize(("view", "times", "pairs", "knots", "activation"), KINDS)
def test_networks_of_every_kind_have_the_same_values(
    view, times, pairs, knots, activation, tmp_path
):
    seen = seen_by(DialPolicy.load(DIAL_FILE), 45.0, 20)
    seen = seen if times else np.ascontiguousarray(seen[:, :-1])
    network = DialNetwork.initialise(
        jax.random.key(1), seen.shape[1], (32, 19), 3, activation, view, (), times, pairs, knots
    )
    path = tmp_path / "dial.safetensors"
    DialPolicy.of(network, 1.0, 0.0, 90.0, {}).save(path)
    _, (theirs, ours) = answers(path, 32.0, seen, tmp_path)
    assert np.ptp(ours, axis=0).min() > 0.001
    np.testing.assert_allclose(theirs, ours, atol=1e-6)


@pytest.mark.parametrize(("angle", "count"), [(45.0, 4), (75.0, 8)])
def test_fleets_end_as_those_of_the_package(angle, count, tmp_path):
    path, seeds = packaged_results() / DIALS[2], np.arange(6, 14)
    (tmp_path / "layout.json").write_text(json.dumps(layout(OPTIONS)))
    words = CORE, tmp_path / "layout.json", path, angle, count, seeds[0], seeds[-1]
    node("page_fleet.mjs", *words, tmp_path / "out.json")
    theirs, dial = json.loads((tmp_path / "out.json").read_text()), DialPolicy.load(path)
    policies, group = [dial.at(dial.low), dial.at(angle)], chosen_cars(seeds, count)
    ours = drive(Intersection(OPTIONS), policies, group, seeds)
    assert [row["endings"] for row in theirs["episodes"]] == ours.ending.tolist()
    lasted = ours.seconds.max(axis=1)
    assert [row["decisions"] for row in theirs["episodes"]] == lasted.tolist()
    arrived, collided = ((ours.ending == end).sum() for end in (Ending.ARRIVAL, Ending.COLLISION))
    assert collided > 0 and theirs["counts"]["collision"] == collided
    assert theirs["counts"]["arrival"] == arrived and theirs["seconds"] == lasted.sum()
    assert theirs["counts"]["rate"] == pytest.approx(60 * arrived / lasted.sum())


def test_what_was_driven_is_a_file_that_train_learns_from(tmp_path):
    (tmp_path / "layout.json").write_text(json.dumps(layout(Options())))
    out = tmp_path / "driven.safetensors"
    node("page_demonstrations.mjs", CORE, tmp_path / "layout.json", DIAL_FILE, out)
    found = files.load(out)
    mine = native(Options(), np.arange(1, 4), DialPolicy.load(DIAL_FILE).at(45.0))
    assert found.n_episodes == 3 and found.mode_names == ("human",)
    np.testing.assert_array_equal(found.action, mine.actions.T[mine.actions.T >= 0])
    rewards = mine.arrays["rewards"][1:] * (mine.actions >= 0)[..., None]
    np.testing.assert_allclose(found.totals().env, rewards[..., 0].sum(axis=0), atol=1e-9)
    words = [
        "train",
        "iq-learn",
        str(out),
        "--world",
        "intersection",
        "--angle",
        "0",
        "--updates",
        "2",
    ]
    assert (
        main([*words, "--hidden", "4", "--set", "batch_size=4", "--out", str(tmp_path / "run")])
        == 0
    )


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """Statements of the page's scripts about the shipped dials."""
    folder = tmp_path_factory.mktemp("told")
    (folder / "layout.json").write_text(json.dumps(layout(Options())))
    (folder / "curve.json").write_text(json.dumps([p._asdict() for p in shipped_dial().curve]))
    caused, words = packaged_results() / CAUSED_STUDY / "dial.safetensors", folder / "told.json"
    files = CORE, folder / "layout.json", DIAL_FILE, caused, folder / "curve.json"
    node("page_story.mjs", *files, STORY_SEED, words)
    return json.loads(words.read_text())


def test_the_seed_of_the_story_shows_what_its_steps_say(told):
    own, even, near, caused = told["story"]
    assert "brake hard" in own and "arrives" in own
    assert "pass" in even and "brake" not in even and "arrives" in even
    assert near.startswith("still waits") and "arrives" in caused and "brake" not in caused


def test_the_dials_own_decisions_are_most_like_its_own_angle(told):
    for row in told["likeness"]:
        assert row["share"] == 1.0
        assert row["low"] <= row["angle"] <= row["high"] and row["high"] - row["low"] <= 6


def test_a_car_is_seldom_excluded_at_its_own_angle_and_always_at_another_ones(told):
    accepted = {row["angle"]: row["accepted"] for row in told["excluded"]}
    wrong = sum(angle not in block for angle, blocks in accepted.items() for block in blocks)
    assert wrong <= 5  # of 24 at 5 % each: 1.2 on average, more than 5 in 1 of 900
    assert not any(45 in block for angle in (0, 75) for block in accepted[angle])
