"""Files that several items begin with: networks, demonstrations, code and traffic of users."""

from __future__ import annotations

import functools
import shutil
import tempfile
from pathlib import Path

from tests.digest.commands import call
from tests.digest.junctions import written
from tests.digest.traces import DEMAND

HALF = "def half(seen):\n    return 0.0 * seen[:, :1] + 0.5\n"
STILL = "import numpy as np\n\n\ndef still(seen):\n    return np.ones(len(seen), np.int64)\n"
SLOW = "import numpy as np\n\n\ndef slow(seen):\n    return np.zeros(len(seen), np.int64)\n"

COMMITTED = {
    "clock_dial.safetensors": "intersection-dial-clock/iterated.safetensors",
    "prosocial.safetensors": "intersection/atlas/prosocial.safetensors",
    "class_dial.safetensors": "crosswalk/dial.safetensors",
    "people_dial.safetensors": "crosswalk-intersection/dial.safetensors",
    "actor_dial.safetensors": "intersection-continuous/dial.safetensors",
}
"""Committed networks by the name of their copy."""

ROW_DEMAND = """<routes>
  <flow id="a" begin="0" end="600" vehsPerHour="360" from="WC0" to="C2N2"/>
  <trip id="b" depart="12.5" from="WC0" to="C2N2"/>
</routes>"""
"""Traffic of a user in the row of three junctions."""


HOLDERS: list[tempfile.TemporaryDirectory] = []
"""Folders that are removed when the process ends."""


@functools.cache
def prepared() -> Path:
    """Make the files that the calls name, once for a process; return their folder."""
    import jax
    from tests.fuzz.samples import SWEEP, make_policies, make_stakeholders

    from socialiq.nn.dial_network import DialNetwork
    from socialiq.nn.dial_policy import DialPolicy
    from socialiq.storage import packaged_results
    from socialiq.worlds.enumerate import tabulate
    from socialiq.worlds.registry import make_grid
    from socialiq.worlds.tabular_policy import TabularPolicy, expert_policy

    holder = tempfile.TemporaryDirectory()
    HOLDERS.append(holder)
    folder = Path(holder.name)
    grid = make_grid("crossing5")
    make_policies(folder, grid.n_features, grid.n_actions)
    network = DialNetwork.initialise(jax.random.key(0), 35, (4,), 5)
    DialPolicy.of(network, 1.0, 0.0, 90.0, {}).save(folder / "scene.safetensors")
    TabularPolicy(grid, expert_policy(tabulate(grid), 45.0)).save(folder / "table.safetensors")
    call("collect", "crossing5", "--episodes", 4, "--out", folder / "steps.safetensors")
    call("data", "to-arrays", folder / "steps.safetensors", "--out", folder / "steps.npz")
    make_stakeholders(folder)
    for name, path in COMMITTED.items():
        shutil.copy(packaged_results() / path, folder / name)
    written(folder)
    (folder / "driver.py").write_text(f"{SLOW}\n\n{STILL}\n\n{HALF}")
    (folder / "mine.rou.xml").write_text(DEMAND)
    (folder / "row.rou.xml").write_text(ROW_DEMAND)
    (folder / "sweep.toml").write_text(SWEEP)
    new = ("profile", "new", "--world", "crossing5", "--angle", 0, "--owner", "x")
    call(*new, "--date", "2026-11-26", "--out", folder / "profile.toml")
    other = ("--set", "arrival=override")
    call(*new, *other, "--date", "2026-11-26", "--out", folder / "other.toml")
    return folder
