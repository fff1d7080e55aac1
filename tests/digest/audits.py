"""Small audits of every kind of policy: verdict, tests, and the table of episodes."""

from __future__ import annotations

import contextlib
import functools
import json
import re
import shutil
from pathlib import Path
from typing import Any
from unittest import mock

from tests.digest.commands import EXAMPLES, call, collected, junction_file, of_csv
from tests.digest.digest import Hashes, Item, of_plain
from tests.digest.files import HALF, SLOW, STILL, prepared

EPISODES = 20
DATE = "2026-11-26"
CODE_SHA256 = "8d6c48bb3731481b2d2193e7608cd888c2b9dd69212c2736bf044945921db710"
CODE = ("--allow-code", "--isolation", "none")
PROCESS = "process:python3 process_policy.py"

AUDITS: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "intersection/rule": ("intersection", "idm", ()),
    "intersection/atlas": ("intersection", "atlas:prosocial", ("--shift",)),
    "intersection/process": ("intersection", PROCESS, ("--isolation", "none")),
    "intersection/callable": ("intersection", "python:driver.py:slow", CODE),
    "intersection/onnx": ("intersection", str(EXAMPLES / "policies/dqn_intersection.onnx"), ()),
    "intersection/sb3": ("intersection", str(EXAMPLES / "policies/dqn_intersection.zip"), ()),
    "intersection-continuous/rule": ("intersection-continuous", "idm", ()),
    "intersection-continuous/atlas": ("intersection-continuous", "atlas:expert_prosocial", ()),
    "intersection-continuous/callable": (
        "intersection-continuous",
        "python:driver.py:half",
        CODE,
    ),
    "merge/callable": (
        "merge",
        "python:driver.py:slow",
        (*CODE, "--reference", "python:driver.py:still"),
    ),
    "roundabout/callable": (
        "roundabout",
        "python:driver.py:slow",
        (*CODE, "--reference", "python:driver.py:still"),
    ),
}
"""World, policy and further options by name."""

BOUNDED: dict[str, tuple[str, str, tuple[str, ...], tuple[object, ...]]] = {
    "intersection/shifted": ("intersection", "gap_3s", (), ("--set", "shift=late,noise=1")),
    "intersection/effects": (
        "intersection", "idm", (), ("--max-delay", 60, "--max-braking", 2),
    ),
    "intersection-crosswalk-bicycles/effects": (
        "intersection-crosswalk-bicycles", "gap_3s", (),
        ("--max-waiting", 5, "--max-cyclist-delay", 5, "--max-pedestrian-hit", 0.5),
    ),
    "intersection-caused/rule": ("intersection-caused", "gap_3s", (), ()),
    "merge/effects": (
        "merge", "python:driver.py:slow", (*CODE, "--reference", "python:driver.py:still"),
        ("--max-delay", 60),
    ),
    "two_way/callable": (
        "two_way", "python:driver.py:slow", (*CODE, "--reference", "python:driver.py:still"), (),
    ),
}  # fmt: skip
"""World, policy, further options and those of the declaration by name."""

PARTS = ("verdict", "tests", "policy_metrics", "references", "angle", "regret", "floors")
ORIGIN = ("record", "source", "sha256", "command", "versions", "content_sha256", "provenance")


def without_origin(value: Any) -> Any:
    """Return a part of a report without what names files, versions and hashes."""
    if isinstance(value, dict):
        return {name: without_origin(one) for name, one in value.items() if name not in ORIGIN}
    return [without_origin(one) for one in value] if isinstance(value, list) else value


def bounded(
    world: str,
    policy: str,
    more: tuple[str, ...],
    declared: tuple[object, ...],
    folder: Path,
) -> Hashes:
    """Audit a policy whose declaration has further options."""
    return audited(world, policy, more, folder, declared)


def audited_by_rule(folder: Path) -> Hashes:
    """Audit a policy that turns its angle, by a declared rule of the angle."""
    for name in ("context.safetensors", "rule.toml"):
        shutil.copy(prepared() / name, folder)
    return audited("crossing5", "context.safetensors", (), folder, ("--angle-rule", "rule.toml"))


def audited(
    world: str,
    policy: str,
    more: tuple[str, ...],
    folder: Path,
    declared: tuple[object, ...] = (),
) -> Hashes:
    """Audit a policy with a fixed seed, from a folder that holds the code of drivers.

    The hash of a rule covers this package's code, so that its seeds would follow every change of a
    line; here it is that of the code by which the digest was made. So is the declaration's date.
    """
    (folder / "driver.py").write_text(f"{SLOW}\n\n{STILL}\n\n{HALF}")
    shutil.copy(EXAMPLES / "policies" / "process_policy.py", folder)
    rule = mock.patch("socialiq.policies.drivers.package_sha256", lambda: CODE_SHA256)
    with contextlib.chdir(folder), rule:
        new = ("profile", "new", "--world", world, "--angle", 45, "--owner", "x")
        call(*new, *declared, "--out", "profile.toml")
        declaration = Path("profile.toml")
        dated = re.sub(r"(?m)^date = .*$", f"date = {DATE}", declaration.read_text())
        declaration.write_text(dated)
        words = ("--profile", "profile.toml", "--episodes", EPISODES, "--seed", 7, "--no-log")
        call("audit", policy, *words, *more, "--out", "report")
        report = json.loads(Path("report/report.json").read_text())
        parts = {name: report[name] for name in PARTS if name in report}
        hashes = {name: of_plain(without_origin(part)) for name, part in parts.items()}
        return hashes | {"episodes": of_csv(Path("report/episodes.csv"))}


def audited_expert(world: str, folder: Path) -> Hashes:
    """Audit a table of actions, which is an expert of a gridworld."""
    from socialiq.worlds.enumerate import tabulate
    from socialiq.worlds.registry import make_grid
    from socialiq.worlds.tabular_policy import TabularPolicy, expert_policy

    table = tabulate(make_grid(world))
    path = folder / "expert.safetensors"
    TabularPolicy(table.world, expert_policy(table, 45.0)).save(path)
    more = ("--shift",) if world == "crossing7" else ()
    return audited(world, path.name, more, folder)


def audited_network(folder: Path) -> Hashes:
    """Audit a network of a gridworld that was trained shortly."""
    data = collected(folder, "crossing7")
    words = ("--updates", 6, "--hidden", 8, "--value-term", "value_expert")
    call("train", "iq-learn", data, *words, "--out", folder / "run")
    (path,) = (folder / "run").glob("*.safetensors")
    path.rename(folder / "policy_0.safetensors")
    return audited("crossing7", "policy_0.safetensors", (), folder)


def audited_at_junction(folder: Path) -> Hashes:
    """Audit a driver by rule at a recorded junction."""
    return audited(junction_file(folder).name, "python:driver.py:slow", CODE, folder)


NEEDS = {"intersection/onnx": ("onnx", "onnxruntime")}

ITEMS = [
    Item("audit/crossing5/expert", functools.partial(audited_expert, "crossing5"), quick=True),
    Item("audit/crossing7/expert", functools.partial(audited_expert, "crossing7")),
    Item("audit/crossing7/network", audited_network),
    *(
        Item(f"audit/{name}", functools.partial(audited, *words), NEEDS.get(name, ()))
        for name, words in AUDITS.items()
    ),
    *(
        Item(f"audit/{name}", functools.partial(bounded, *words), NEEDS.get(name, ()))
        for name, words in BOUNDED.items()
    ),
    Item("audit/crossing5/rule", audited_by_rule),
    Item("audit/recorded-junction/callable", audited_at_junction, ("shapely",)),
]
