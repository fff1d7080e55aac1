"""Systems without `fcntl` and `resource`: import works; a limit that cannot be set is refused."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from socialiq import isolation
from socialiq.errors import UserError
from socialiq.policies import process
from socialiq.policies.load import load_policy
from socialiq.policies.process import GIB, Limits

LAUNCHERS = Path(isolation.__file__).with_name("launchers.py")
ANSWERS = """
import json, sys
json.loads(input())
print(json.dumps({"protocol": "socialiq-policy", "version": 1, "features": 2, "actions": 3}))
sys.stdout.flush()
request = json.loads(input())
print(json.dumps({"id": request["id"], "actions": [1] * len(request["observations"])}))
sys.stdout.flush()
"""


def without(*modules):
    """Start of a program that can import none of these."""
    return "import sys; " + "".join(f"sys.modules[{name!r}] = None; " for name in modules)


def test_the_package_imports_without_them():
    rooms = ("policies.load", "policies.process", "cli.data")
    modules = [*(f"socialiq.{room}" for room in rooms), "socialiq_recordings.cli.files"]
    program = without("fcntl", "resource") + "; ".join(f"import {module}" for module in modules)
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", program], capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("module", [None, SimpleNamespace()])
def test_a_limit_that_cannot_be_set_is_refused(tmp_path, monkeypatch, module):
    (tmp_path / "answers.py").write_text(ANSWERS)
    command = f"process:{sys.executable} -I -S {tmp_path / 'answers.py'}"
    monkeypatch.setitem(sys.modules, "resource", module)
    with pytest.raises(UserError, match="sets no memory limit for a process: pass --memory-gib 0"):
        load_policy(command, 2, 3, limits=Limits(memory=GIB))
    with load_policy(command, 2, 3, limits=Limits(memory=0)) as loaded:
        assert loaded.policy.predict(np.zeros((2, 2), np.float32))[0].tolist() == [1, 1]


def test_a_system_without_process_groups_is_refused(monkeypatch):
    monkeypatch.setattr(process, "os", SimpleNamespace(name="nt"))
    with pytest.raises(UserError, match="needs Linux or macOS: export it to ONNX"):
        load_policy(f"process:{sys.executable}", 2, 3)


@pytest.mark.parametrize(("memory", "status"), [(0, 7), (GIB, 126)])
def test_the_guard_without_resource(memory, status):
    program = (
        f"{without('resource')}import os, runpy; lifeline, _ = os.pipe(); "
        f"sys.argv = ['launchers', 'guard', str(lifeline), '{memory}']; "
        f"sys.argv += [sys.executable, '-c', 'exit(7)']; "
        f"runpy.run_path({str(LAUNCHERS)!r}, run_name='__main__')"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, start_new_session=True
    )
    assert done.returncode == status
    said = "" if status == 7 else "this system sets no memory limit: pass --memory-gib 0\n"
    assert done.stderr == said
