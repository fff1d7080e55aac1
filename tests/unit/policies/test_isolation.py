"""Isolation that is not there, and the command line of a sandbox; `tests/extras` runs real ones."""

import sys
from pathlib import Path

import pytest
from tests.patience import LONGER

from socialiq import isolation
from socialiq.errors import UserError
from socialiq.isolation import NONE, CodeHash, isolation_of, sandboxed


def fake(folder, text):
    """Put a program named bwrap on an otherwise empty search path."""
    program = folder / "bwrap"
    program.write_text(f"#!{sys.executable} -IS\n{text}\n")
    program.chmod(0o755)


def test_without_bubblewrap_nothing_is_isolated(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert isolation_of("auto") == (NONE, "bubblewrap is not installed")
    assert not isolation_of("auto").works
    with pytest.raises(UserError, match="isolation is required, but bubblewrap is not installed"):
        isolation_of("required")


def test_bubblewrap_that_makes_no_sandbox(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    fake(tmp_path, "import sys; sys.exit('bwrap: No permissions \\x1b[2J to create a namespace')")
    found = isolation_of("auto")
    said = "bubblewrap makes no sandbox here: bwrap: No permissions [2J to create a namespace"
    assert found == (NONE, said)
    with pytest.raises(UserError, match="isolation is required, but bubblewrap makes no sandbox"):
        isolation_of("required")


def test_bubblewrap_that_hangs(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(isolation, "_SECONDS", 0.2)
    fake(tmp_path, f"import time; time.sleep({LONGER})")
    assert isolation_of("auto").why.startswith("bubblewrap does not start")


def test_bubblewrap_that_works_is_named_with_its_version(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    fake(tmp_path, "print('bubblewrap 9.9')")
    assert isolation_of("auto") == isolation_of("required") == ("bubblewrap 9.9", "")
    assert isolation_of("none") == (NONE, "it was not asked for")


def test_isolation_is_one_of_three():
    with pytest.raises(UserError, match="auto, required, none"):
        isolation_of("perhaps")


def bound(words):
    return [words[place + 2] for place, word in enumerate(words) if word == "--ro-bind"]


def test_the_sandbox_sees_what_is_covered_and_the_system(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    policy = tmp_path / "policy"
    policy.mkdir(mode=0o755)
    inner = policy / "weights"
    inner.touch(mode=0o644)
    words = sandboxed(
        ["sh", "x"], CodeHash("", "", {one: one for one in (policy, inner, Path("/usr/bin/env"))})
    )
    seen = bound(words)
    assert str(policy) in seen and "/usr" in seen
    # A folder shows its files, and the system's are shown already.
    assert str(inner) not in seen and "/usr/bin/env" not in seen
    assert str(tmp_path) not in seen and str(Path.home()) not in seen and "/" not in seen
    assert words[-1] == "x" and words[words.index("--chdir") + 1] == str(tmp_path)


def test_folders_without_a_python_are_no_interpreters(tmp_path, monkeypatch):
    home = tmp_path / "home"
    for folder in (home, tmp_path / "other"):
        (folder / "bin").mkdir(parents=True)
        (folder / "bin" / "tool").touch(mode=0o755)
    (home / "pyvenv.cfg").touch()
    monkeypatch.setattr(Path, "home", lambda: home)
    for folder in (home, tmp_path / "other"):
        words = sandboxed([str(folder / "bin" / "tool")], CodeHash("", "", {}))
        assert str(folder) not in bound(words)


def test_another_user_than_root_has_a_namespace_of_its_own(monkeypatch):
    monkeypatch.setattr(isolation.os, "geteuid", lambda: 1000)
    assert "--unshare-all" in sandboxed(["sh"], CodeHash("", "", {}))


def test_a_version_managers_shim_is_refused(tmp_path, monkeypatch):
    shim = tmp_path / "shims" / "python3"
    shim.parent.mkdir()
    shim.write_text("#!/bin/sh\n")
    shim.chmod(0o755)
    monkeypatch.setenv("PATH", str(shim.parent))
    with pytest.raises(UserError, match=r"shim of a version manager.*pyenv which python3"):
        sandboxed(["python3", "policy.py"], CodeHash("", "", {}))
