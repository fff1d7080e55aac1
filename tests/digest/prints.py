"""Numbers, tables and arrays that each command prints as JSON and writes, without origins."""

from __future__ import annotations

import contextlib
import functools
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
from safetensors.numpy import load_file
from tests.digest.audits import without_origin
from tests.digest.commands import call, junction_file, of_csv
from tests.digest.digest import Hashes, Item, of_arrays, of_plain
from tests.digest.files import prepared

VOLATILE = (
    "seconds",
    "machine",
    "out",
    "file",
    "folder",
    "folders",
    "without_log",
    "fingerprint",
    "engine",
    "isolation",
)
"""Further keys of results whose values hang on the machine or on a place."""

DIAL = "clock_dial.safetensors"
ATLAS = "prosocial.safetensors"
CODED = ("--policy", "python:driver.py:slow", "--allow-code")
FEW = ("--episodes", 4, "--seed", 5)
ROLLED = ("--episodes", 6, "--seed", 5)

Words = tuple[object, ...]

QUICK: dict[str, Words] = {
    "solve/crossing7": ("solve", "crossing7", "--angle", 30),
    "solve/stationary": ("solve", "crossing5", "--stationary"),
    "solve/crosswalk7": ("solve", "crosswalk7-60", "--angle", 60),
    "front/crossing7": ("front", "crossing7"),
    "predict-lambda/crossing7": ("predict-lambda", "crossing7", "--target-kind", "to_go"),
    "predict-lambda/crossing5": ("predict-lambda", "crossing5", "--angle", 45),
    "collect/crossing7": ("collect", "crossing7", *FEW, "--out", "out.safetensors"),
    "collect/road": (
        "collect", "socialiq/Intersection-v1", "--driver", f"a={ATLAS}", "--driver",
        "b=python:driver.py:slow", "--set", "shift=late", *FEW, "--allow-code",
        "--out", "out.safetensors",
    ),
    "collect/steering": (
        "collect", "intersection-continuous-steering", "--driver", "idm", "--driver", "go", *FEW,
        "--out", "out.safetensors",
    ),
    "dial/crossing5": ("dial", "crossing5", "--policy", "dial.safetensors", "--every", 45),
    "turn/dial": ("turn", "dial.safetensors", "--angle", 30, "--out", "out.safetensors"),
    "turn/rule": (
        "turn", "dial.safetensors", "--angle-rule", "rule.toml", "--out", "out.safetensors",
    ),
    "turn/class-dial": (
        "turn", "class_dial.safetensors", "--angle", 30, "--class-angle", 60,
        "--out", "out.safetensors",
    ),
    "turn/actor-dial": (
        "turn", "actor_dial.safetensors", "--angle", 30,
        "--out", "out.safetensors",
    ),
    "ensemble": (
        "ensemble", "policy.safetensors", "policy.safetensors", "--out", "out.safetensors",
    ),
    "evaluate/crossing5": ("evaluate", "policy.safetensors", "--world", "crossing5"),
    "evaluate/soft": ("evaluate", "policy.safetensors", "--world", "crossing5", "--soft"),
    "evaluate/sampled": (
        "evaluate", "ensemble.safetensors", "--world", "crossing5", *ROLLED,
    ),
    "evaluate/several": (
        "evaluate", "policy.safetensors", "table.safetensors", "--world", "crossing5",
    ),
    "evaluate/rule": (
        "evaluate", "context.safetensors", "--world", "crossing5", "--angle-rule", "rule.toml",
    ),
    "evaluate/intersection": ("evaluate", "gap_3s", "--world", "intersection", *ROLLED),
    "evaluate/dial": ("evaluate", DIAL, "--world", "intersection", "--angle", 45, *ROLLED),
    "evaluate/soft-network": ("evaluate", ATLAS, "--world", "intersection", "--soft", *ROLLED),
    "evaluate/shifted": (
        "evaluate", ATLAS, "--world", "intersection", "--shift", "late,noise=1",
        "--front-end", "known", *ROLLED,
    ),
    "evaluate/shield": (
        "evaluate", "go", "--world", "intersection-crosswalk-60", "--shield", 2.0, *ROLLED,
    ),
    "evaluate/bicycles": (
        "evaluate", "people_dial.safetensors", "--world",
        "intersection-crosswalk-bicycles", "--angle", 30, *ROLLED,
    ),
    "evaluate/continuous": (
        "evaluate", "actor_dial.safetensors", "--world",
        "intersection-continuous", "--angle", 30, *ROLLED,
    ),
    "evaluate/merge": (
        "evaluate", "python:driver.py:slow", "--world", "merge", "--allow-code", *ROLLED,
    ),
    "evaluate/junction": (
        "evaluate", "python:driver.py:slow", "--world", "junction.safetensors", "--allow-code",
        *ROLLED,
    ),
    "effects/intersection": (
        "effects", "intersection", "--policy", "gap_3s", "--policy", DIAL, "--angle", 0, 90,
        *FEW, "--out", "out",
    ),
    "effects/shifted": (
        "effects", "intersection", "--policy", "go", "--shift", "late or noise=1",
        "--after-timeout", "removed", "--horizon", 25, "--tow-after", 0, *FEW, "--out", "out",
    ),
    "effects/people": (
        "effects", "intersection-crosswalk-bicycles", "--policy", "gap_3s", "--shield", 1.0, *FEW,
        "--out", "out",
    ),
    "effects/merge": ("effects", "merge", *CODED, *FEW, "--out", "out"),
    "effects/two_way": ("effects", "two_way", *CODED, *FEW, "--out", "out"),
    "effects/junction": (
        "effects", "junction.safetensors", "--policy", "driver", *FEW, "--out", "out",
    ),
    "effects/crossing5": ("effects", "crossing5", "--policy", "policy.safetensors"),
    "population/intersection": (
        "population", "intersection", "--policy", DIAL, "--angle", 0, 90, "--agents", 3,
        "--duration", 15, *FEW, "--out", "out",
    ),
    "population/roundabout": (
        "population", "roundabout", "--policy", "scene.safetensors", "--angle", 0, 45,
        "--agents", 3, *FEW, "--out", "out",
    ),
    "stakeholders": (
        "stakeholders", "episodes.csv", "--utilities", "people.toml", "--resamples", 40,
        "--out", "out",
    ),
    "export/torch": (
        "export", "policy.safetensors", "--format", "torch", "--out", "out.safetensors",
    ),
    "export/torch-ensemble": (
        "export", "ensemble.safetensors", "--format", "torch", "--out", "out.safetensors",
    ),
    "profile/check": ("profile", "check", "profile.toml"),
    "data/to-arrays": ("data", "to-arrays", "steps.safetensors", "--out", "out.npz"),
    "data/to-table": ("data", "to-arrays", "steps.safetensors", "--out", "out.csv"),
    "data/from-arrays": ("data", "from-arrays", "steps.npz", "--out", "out.safetensors"),
    "data/trust": ("data", "trust", "steps.safetensors", "--out", "out"),
}  # fmt: skip
"""Words of each call that is quick, in a folder of `prepared` files."""

SLOW_CALLS: dict[str, Words] = {
    "front/crosswalk7": ("front", "crosswalk7", "--every", 45),
    "collect/equal-transitions": (
        "collect", "crossing7", "--mixture", "equal_transitions", "--transitions", 40, "--clock",
        "--out", "out.safetensors",
    ),
    "collect/weighted": (
        "collect", "crossing7", "--mixture", "weighted", "--weights", 1, 2, 3, "--episodes", 12,
        "--set", "braking=one_level", "--out", "out.safetensors",
    ),
    "collect/contaminated": (
        "collect", "crossing7", "--mixture", "contaminated", "--share", 0.5, "--episodes", 8,
        "--out", "out.safetensors",
    ),
    "collect/hater": (
        "collect", "crossing7", "--malicious", "hater", "--forge", "adaptive", "--share", 0.5,
        "--episodes", 8, "--out", "out.safetensors",
    ),
    "collect/rammer": (
        "collect", "crosswalk7", "--malicious", "rammer", "--forge", "absolute", "--share", 0.5,
        "--episodes", 8, "--out", "out.safetensors",
    ),
    "dial/intersection": ("dial", "intersection", "--policy", DIAL, "--every", 45, *ROLLED),
    "dial/continuous": (
        "dial", "intersection-continuous", "--policy",
        "actor_dial.safetensors", "--every", 45, *ROLLED,
    ),
    "dial/class-dial": (
        "dial", "crosswalk7", "--policy", "class_dial.safetensors", "--every", 45,
    ),
    "unlikeness": (
        "unlikeness", ATLAS, "--episodes", 6, "--shift", "noise=1", "--out", "out.safetensors",
    ),
    "evaluate/data": (
        "evaluate", "policy.safetensors", "--data", "steps.safetensors", "--seed", 3,
    ),
    "evaluate/processes": (
        "evaluate", "gap_3s", "--world", "intersection", "--processes", 1, *ROLLED,
    ),
    "sweep": ("sweep", "sweep.toml", "--processes", 1, "--out", "out"),
}  # fmt: skip
"""Words of the others."""

IN_SUMO: dict[str, Words] = {
    "world/sumo": ("world", "sumo", "crossing"),
    "world/sumo-row": ("world", "sumo", "row", "--demand", "row.rou.xml"),
    "evaluate/sumo": ("evaluate", "gap_3s", "--world", "sumo", *FEW),
    "effects/sumo": ("effects", "sumo", "--policy", "gap_3s", "--policy", "go", *FEW),
    "effects/demand": ("effects", "sumo", "--policy", "wait", "--demand", "mine.rou.xml", *FEW),
}
"""Words of calls of worlds in SUMO."""

RECORDED: dict[str, Words] = {
    "data/inspect": ("data", "inspect", "recording.safetensors"),
    "data/conflicts": ("data", "conflicts", "recording.safetensors", "--out", "out"),
    "data/world": ("data", "world", "recording.safetensors", "--out", "out.safetensors"),
    "data/demonstrations": (
        "data",
        "demonstrations",
        "recording.safetensors",
        "--out",
        "out.safetensors",
    ),
    "data/census": ("data", "census", "recording.safetensors", "--out", "out"),
}
"""Words of calls on recorded traffic."""

PROFILES: dict[str, Words] = {
    "crossing7": ("--world", "crossing7", "--angle", 45),
    "intersection": ("--world", "intersection", "--angle", 0, "--set", "spawn_probability=0.6"),
    "people": (
        "--world", "intersection-crosswalk-bicycles", "--angle", 60, "--max-waiting", 5,
        "--max-cyclist-delay", 5, "--max-pedestrian-hit", 0.5,
    ),
    "continuous": ("--world", "intersection-continuous", "--angle", 30),
    "merge": ("--world", "merge", "--angle", 45, "--max-delay", 40),
    "junction": ("--world", "junction.safetensors", "--angle", 45),
    "environment": ("--world", "socialiq/TwoWay-v1", "--angle", 10),
}  # fmt: skip
"""Words of declarations by name."""


def printed(*words: object) -> Any:
    """Run a command in this process; return the JSON object that it prints.

    Raises:
        RuntimeError: If it fails.
    """
    from socialiq.cli.main import main

    output = io.StringIO()
    errors = io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):
        status = main([*map(str, words), "--json"])
    if status not in (0, 1, 3):
        raise RuntimeError(f"{' '.join(map(str, words))}: {errors.getvalue()}")
    return json.loads(output.getvalue())


def without_places(value: Any) -> Any:
    """Return a result without what hangs on places, times, versions and hashes of files."""
    if isinstance(value, dict):
        kept = {name: entry for name, entry in value.items() if name not in VOLATILE}
        return without_origin({name: without_places(entry) for name, entry in kept.items()})
    return [without_places(entry) for entry in value] if isinstance(value, list) else value


def written_in(folder: Path) -> Hashes:
    """Hash the tables and arrays of each new file, by its name."""
    hashes = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.suffix == ".csv":
            hashes[name] = of_csv(path, VOLATILE)
        elif path.suffix == ".safetensors":
            hashes[name] = of_arrays(load_file(path))
        elif path.suffix == ".npz":
            with np.load(path, allow_pickle=False) as arrays:
                hashes[name] = of_arrays({one: arrays[one] for one in arrays.files})
    return hashes


def of_call(words: Words, folder: Path) -> Hashes:
    """Run a command where the files lie; hash what it prints and what it writes into a folder.

    Files named `out...` are written, in the empty folder.
    """
    with contextlib.chdir(prepared()):
        placed = [folder / str(word) if str(word).startswith("out") else word for word in words]
        result = without_places(printed(*placed))
    return {"printed": of_plain(result)} | written_in(folder)


def of_recorded(words: Words, folder: Path) -> Hashes:
    """Run a command on a simulated recording."""
    (folder / "out").mkdir()
    junction_file(folder)
    (recording,) = (folder / "imported").glob("*.safetensors")
    placed: list[object] = []
    for word in words:
        text = str(word)
        is_output = text.startswith("out")
        placed.append(recording if text.startswith("rec") else word)
        if is_output:
            placed[-1] = folder / "out" / f"new{text.removeprefix('out')}"
    return {"printed": of_plain(without_places(printed(*placed)))} | written_in(folder / "out")


def of_profile(words: Words, folder: Path) -> Hashes:
    """Write and check a declaration; hash all that it declares."""
    with contextlib.chdir(prepared()):
        path = folder / "declared.toml"
        call("profile", "new", *words, "--owner", "x", "--date", "2026-11-26", "--out", path)
        return {"declared": of_plain(without_places(printed("profile", "check", path)))}


def of_verified(folder: Path) -> Hashes:
    """Audit in two scenarios, verify a report, and give one verdict on both."""
    policy = "policy.safetensors"
    with contextlib.chdir(prepared()):
        for name in ("profile", "other"):
            words = ("--profile", f"{name}.toml", "--episodes", 20, "--seed", 7, "--no-log")
            call("audit", policy, *words, "--out", folder / name)
        report = folder / "profile"
        results = {
            "verified": printed("audit", "verify", report),
            "again": printed("audit", "verify", report, "--rerun", "--policy", policy),
            "across": printed("audit", "across", report, folder / "other"),
        }
    return {name: of_plain(without_places(result)) for name, result in results.items()}


ITEMS = [
    *(
        Item(f"command/{name}", functools.partial(of_call, words), quick=True)
        for name, words in QUICK.items()
    ),
    *(
        Item(f"command/{name}", functools.partial(of_call, words))
        for name, words in SLOW_CALLS.items()
    ),
    *(
        Item(f"command/{name}", functools.partial(of_call, words), ("libsumo",))
        for name, words in IN_SUMO.items()
    ),
    *(
        Item(f"command/{name}", functools.partial(of_recorded, words), ("shapely",))
        for name, words in RECORDED.items()
    ),
    *(
        Item(f"command/profile/{name}", functools.partial(of_profile, words), quick=True)
        for name, words in PROFILES.items()
    ),
    Item("command/audit/verify", of_verified),
]
