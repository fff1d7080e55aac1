"""Faults on the page beside those of the package: the same bits shown, the same episodes."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from socialiq.nn.dial_policy import DialPolicy
from socialiq.page.data import FAMILY, STUDY
from socialiq.page.webassembly.layout import CORE, layout
from socialiq.storage import packaged_results
from socialiq.worlds.highway.shifts import shift_of
from socialiq.worlds.intersection.options import IDLE, Options
from socialiq.worlds.intersection.world import Intersection

pytestmark = pytest.mark.skipif(not shutil.which("node"), reason="Node.js is not installed")

DIAL = packaged_results() / STUDY / f"{FAMILY}.safetensors"
SEEDS = np.arange(90_000_000, 90_000_040)
QUICK = [("late", False), ("late", True), ("latency=2,unseen=0.5,noise=5", True)]
SLOW = [(name, front) for name in ("none", "unseen-30", "noise-3") for front in (False, True)]
SLOW.append(("latency=2,unseen=0.5,noise=5", False))


def driven(shift, front):
    """Episodes of the dial at 45 degrees: what was there, was shown and was decided; endings."""
    batch = Intersection().shifted(str(shift), "known" if front else "").batch(len(SEEDS))
    dial, ending = DialPolicy.load(DIAL).at(45.0), np.zeros(len(SEEDS), int)
    episodes = [{"observations": [], "shown": [], "decided": []} for _ in SEEDS]
    batch.reset(SEEDS)
    while (running := batch.running.copy()).any():
        there, shown = batch.buffers.observation.reshape(len(SEEDS), -1), batch.seen_by(dial)
        chosen = dial.predict(shown, deterministic=True)[0]
        for number in np.flatnonzero(running):
            row = there[number].tolist(), shown[number].tolist(), int(chosen[number])
            for kept, value in zip(episodes[number].values(), row, strict=True):
                kept.append(value)
        ending[running] = batch.step(chosen, auto_reset=False, rows=running).ending[running]
    return episodes, ending


def on_page(shift, front, folder, recorded=None):
    """The same episodes by the page's scripts."""
    (folder / "layout.json").write_text(json.dumps(layout(Options())))
    faults = {name: getattr(shift, name) for name in ("latency", "unseen", "noise")}
    job = {"shift": faults | {"front": front}, "seeds": SEEDS.tolist(), "recorded": recorded}
    (folder / "job.json").write_text(json.dumps(job))
    files = CORE, folder / "layout.json", DIAL, 45, folder / "job.json", folder / "out.json"
    script = Path(__file__).with_name("page_shifted.mjs")
    subprocess.run(["node", str(script), *map(str, files)], check=True)
    return json.loads((folder / "out.json").read_text())


@pytest.mark.parametrize(
    ("name", "front"),
    [*QUICK, *(pytest.param(*case, marks=pytest.mark.slow) for case in SLOW)],
)
def test_faults_and_front_end_are_those_of_the_package(name, front, tmp_path):
    shift = shift_of(name)
    ours, ending = driven(shift, front)
    again = on_page(shift, front, tmp_path, ours)
    for mine, theirs in zip(ours, again, strict=True):  # of the same observations, to the last bit
        np.testing.assert_array_equal(np.float32(theirs["shown"]), np.float32(mine["shown"]))
    theirs, still = on_page(shift, front, tmp_path), [IDLE] * shift.latency
    for mine, episode in zip(ours, theirs, strict=True):
        assert (still + mine["decided"])[: len(mine["decided"])] == episode["actions"]
    assert [episode["ending"] for episode in theirs] == ending.tolist()
    assert len({*ending.tolist()}) > 1
