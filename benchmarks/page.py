"""The page's speed: its core in Node beside the native one, and the page in a headless Chromium.

Both cores take random actions in 64 episodes on one thread, resets included. Seconds are of the
processor, so that other work on the machine doesn't count; medians are given.
"""

from __future__ import annotations

import importlib.util
import json
import shutil
import statistics
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.errors import UserError
from socialiq.page.webassembly.layout import CORE, layout
from socialiq.page.write import write_page
from socialiq.worlds.highway.scene_batch import Batch
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.world import Intersection

BROWSERS = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")
MEASURED = {
    # The page may be ready before the browser has recorded its first picture.
    "first_picture_ms": """() => new Promise((done) => {
      const found = (list) => done(list.getEntries()[0].startTime);
      new PerformanceObserver(found).observe({ type: "paint", buffered: true });
    })""",
    "first_scene_ms": "performance.getEntriesByName('ready')[0].startTime",
    "pictures_per_s": """() => new Promise((done) => {
      const { clock } = twins;
      Object.assign(clock, { time: 0, frames: 0 });
      clock.play();
      const begun = performance.now();
      setTimeout(() => done((1000 * clock.frames) / (performance.now() - begun)), 4000);
    })""",
    "ms_per_degree": """() => {
      twins.clock.pause();
      const begun = performance.now();
      for (let angle = 0; angle < 90; angle += 3) twins.turn(angle);
      return (performance.now() - begun) / 30;
    }""",
    "ms_of_500_episodes": """async () => {
      const begun = performance.now();
      await twins.background({ angles: [45], first: 1, count: 500 });
      return performance.now() - begun;
    }""",
}
"""Scripts that measure the page: three twins of the first seed."""

ROWS = 64
DECISIONS = 30_000


def run(repeats: int) -> dict[str, Any]:
    """Measure each side in turn, `repeats` times.

    Returns:
        Medians by name: decisions per second, their ratio, bytes of the file.

    Raises:
        UserError: If Node isn't installed.
    """
    node = shutil.which("node")
    if node is None:
        raise UserError("Node.js isn't installed: install it, for example the package nodejs")
    options, native, in_node = Options(), [], []
    batch = Intersection(options).batch(ROWS)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "layout.json"
        path.write_text(json.dumps(layout(options)))
        script = Path(__file__).with_name("rate.mjs")
        words = [node, str(script), str(CORE), str(path), str(ROWS), str(DECISIONS)]
        for _ in range(repeats):
            native.append(native_rate(batch))
            done = subprocess.run(words, capture_output=True, text=True, check=True)
            in_node.append(float(done.stdout))
    return {
        "native_decisions_per_s": statistics.median(native),
        "node_decisions_per_s": statistics.median(in_node),
        "ratio": float(np.median(np.divide(in_node, native))),
        "bytes": CORE.stat().st_size,
        **in_browser(),
    }


def in_browser() -> dict[str, Any]:
    """Return times of the page in a headless Chromium, by wall clock; none without one."""
    browser = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if browser is None or importlib.util.find_spec("playwright") is None:
        return {}
    from playwright import sync_api

    with tempfile.TemporaryDirectory() as folder, sync_api.sync_playwright() as playwright:
        launched = playwright.chromium.launch(
            executable_path=browser, args=["--no-sandbox", "--disable-gpu"]
        )
        tab = launched.new_page(viewport={"width": 1280, "height": 1000})
        tab.set_default_timeout(120_000)
        tab.goto(f"{write_page(Path(folder)).as_uri()}#step=1", wait_until="commit")
        tab.wait_for_selector("html[data-ready]", state="attached")
        found = {name: tab.evaluate(script) for name, script in MEASURED.items()}
        launched.close()
    return found


def native_rate(batch: Batch) -> float:
    """Decisions per second of the processor, of a batch under random actions, resets included."""
    rounds = -(-DECISIONS // batch.size)
    actions = np.random.default_rng(0).integers(3, size=(rounds, batch.size))
    batch.reset(0)
    begin = time.process_time()
    for row in actions:
        batch.step(row)
    return rounds * batch.size / (time.process_time() - begin)
