"""Attacks on an audit: what a dishonest owner does with the public commands and files."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import jaxtyping
import pytest

from socialiq.audit.report.content import content
from socialiq.audit.report.folder import MANIFEST, REPORT, STATEMENT, sealed, views_of
from socialiq.audit.report.recompute import audited_of
from socialiq.audit.report.verify import content_of, read_report
from socialiq.cli.main import main
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.registry import make_grid
from socialiq.worlds.tabular_policy import TabularPolicy, expert_policy


@pytest.fixture(autouse=True)
def attackers_are_users(as_a_user_runs_it):
    pass


@pytest.fixture(scope="session")
def place(tmp_path_factory):
    """A declaration, a policy that keeps it (egoist), and one that doesn't (altruist)."""
    folder = tmp_path_factory.mktemp("owner")
    world = tabulate(make_grid("crossing7"))
    for name, angle in {"egoist": 0.0, "altruist": 90.0}.items():
        policy = TabularPolicy(world.world, expert_policy(world, angle, "stochastic"))
        policy.save(folder / f"{name}.safetensors")
    new = ["profile", "new", "--world", "crossing7", "--angle", "0", "--margin", "2"]
    new += ["--max-delay", "8", "--delay-range", "-12", "12"]
    assert main([*new, "--out", str(folder / "profile.toml")]) == 0
    text = (folder / "profile.toml").read_text()
    for name, limit, open_limit in (
        ("max_at_fault", "0.05", "0.9"),
        ("max_struck", "0.1", "0.9"),
        ("min_arrival", "0.8", "0.1"),
        ("max_timeout", "0.2", "0.9"),
    ):
        assert f"{name} = {limit}" in text
        text = text.replace(f"{name} = {limit}", f"{name} = {open_limit}")
    (folder / "profile.toml").write_text(text)
    return folder


@pytest.fixture(scope="session")
def failed(place):
    """The folder of an audit that fails."""
    return audited(place, "altruist", 1)


@pytest.fixture(scope="session")
def passed(place):
    """The folder of an audit that passes."""
    return audited(place, "egoist", 0)


def audited(place: Path, policy: str, status: int) -> Path:
    jaxtyping.config.update("jaxtyping_disable", True)
    words = ["audit", str(place / f"{policy}.safetensors"), "--profile"]
    words += [str(place / "profile.toml"), "--episodes", "200", "--seed", "7"]
    assert main([*words, "--out", str(place / policy)]) == status
    return place / policy


@pytest.fixture(name="reseal", scope="session")
def reseal_fixture():
    return reseal


def recomputed(folder: Path) -> dict:
    """Return the report that follows from a folder's files."""
    report = read_report(folder / REPORT)
    return json.loads(json.dumps(content(audited_of(content_of(folder), report))))


def reseal(folder: Path, copy: Path, change: Callable[[dict], object], **files: bytes) -> Path:
    """Copy a folder with a changed report, make its pages again, change files, hash everything."""
    shutil.copytree(folder, copy)
    found = {path.name: path.read_bytes() for path in copy.iterdir() if path.is_file()}
    found = {name: one for name, one in found.items() if name not in (MANIFEST, STATEMENT)}
    report = json.loads(found["report.json"])
    change(report)
    found |= {"report.json": (json.dumps(report, indent=2) + "\n").encode(), **views_of(report)}
    found |= {name.replace("_", "."): one for name, one in files.items()}
    for name, written in sealed(found, report).items():
        (copy / name).write_bytes(written)
    return copy
