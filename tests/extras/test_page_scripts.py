"""The page's scripts beside the package: its network decides alike, its files are ours."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from socialiq.cli.main import main
from socialiq.demonstrations import files
from socialiq.nn.dial_policy import DialPolicy
from socialiq.page.webassembly.equality import DIAL
from socialiq.page.webassembly.layout import layout
from socialiq.page.webassembly.replay import CORE, native
from socialiq.storage import packaged_results
from socialiq.worlds.intersection.options import Options

pytestmark = pytest.mark.skipif(not shutil.which("node"), reason="Node.js is not installed")

HERE = Path(__file__).parent
DIAL_FILE = packaged_results() / DIAL


def node(script, *words):
    subprocess.run(["node", str(HERE / script), *map(str, words)], check=True)


def decisions(dial, angle, episodes, folder):
    """Decisions of the page and of the package on all that the dial sees in some episodes."""
    policy = dial.at(angle)
    driven = native(Options(), np.arange(50_000_000, 50_000_000 + episodes), policy)
    seen = driven.arrays["observation"][:-1][driven.actions >= 0].reshape(-1, 70)
    (folder / "seen.bin").write_bytes(seen.astype("<f4").tobytes())
    node("page_network.mjs", DIAL_FILE, folder / "seen.bin", angle, 70, folder / "decided.bin")
    theirs = np.fromfile(folder / "decided.bin", np.uint8)
    return theirs, policy.predict(seen, deterministic=True)[0]


def test_the_networks_decide_alike(tmp_path):
    theirs, ours = decisions(DialPolicy.load(DIAL_FILE), 45.0, 60, tmp_path)
    assert len(ours) > 500 and len(set(ours.tolist())) == 3
    np.testing.assert_array_equal(theirs, ours)


@pytest.mark.slow
def test_the_networks_decide_alike_on_100000_observations(tmp_path):
    dial, count = DialPolicy.load(DIAL_FILE), 0
    for angle in np.arange(0.0, 91.0, 15.0).tolist():
        theirs, ours = decisions(dial, angle, 1_050, tmp_path)
        assert (theirs != ours).sum() == 0, angle
        count += len(ours)
    assert count >= 100_000


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
    words = ["train", str(out), "--world", "intersection", "--angle", "0", "--updates", "2"]
    assert main([*words, "--hidden", "4", "--batch-size", "4", "--out", str(tmp_path / "run")]) == 0
