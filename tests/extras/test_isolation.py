"""Policies in real sandboxes (needs bubblewrap): what they see, what they may use, and their end.

Both ways of isolation are run where the tests run as root: as a user without rights, and in a
namespace of users, as for any other user.
"""

import contextlib
import os
import shlex
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from tests.patience import HANG, LONGER, wait_until

from socialiq import isolation
from socialiq.errors import UserError
from socialiq.isolation import DISK, isolation_of
from socialiq.policies.load import load_policy
from socialiq.policies.process import GIB, Limits

OBSERVATIONS = np.random.default_rng(0).normal(size=(40, 2)).astype(np.float32)
REQUIRED = {"limits": Limits(start=HANG, step=HANG)}

# It tells what a line of Python finds by ending with it.
POLICY = """
import json, os, pathlib, resource, subprocess, sys, time
for line in sys.stdin:
    message = json.loads(line)
    if "protocol" in message:
        answer = dict(message)
    else:
        try:
            found = WHAT
        except OSError as error:
            found = type(error).__name__
        sys.exit(f"found {found}")
    print(json.dumps(answer), flush=True)
"""


@pytest.fixture(autouse=True, params=["as this user", "as another user"])
def user(request, monkeypatch):
    isolation._tried.cache_clear()
    if request.param == "as another user":
        monkeypatch.setattr(isolation.os, "geteuid", lambda: 1000)
    yield request.param
    isolation._tried.cache_clear()


def started(tmp_path, what, words=(), **more):
    policy = tmp_path / "policy.py"
    policy.write_text(POLICY.replace("WHAT", what))
    command = shlex.join([sys.executable, "-I", "-S", str(policy), *map(str, words)])
    more = REQUIRED | {"isolation": isolation_of("required")} | more
    return load_policy(f"process:{command}", 2, 3, **more)


def found(tmp_path, what, words=(), **more):
    with (
        started(tmp_path, what, words, **more) as loaded,
        pytest.raises(UserError, match="last error line: found") as caught,
    ):
        loaded.policy.predict(OBSERVATIONS)
    return str(caught.value).partition("found ")[2]


def test_it_sees_what_its_hash_covers(tmp_path):
    model, folder, hidden = (tmp_path / name for name in ("model", "folder", "hidden"))
    folder.mkdir(mode=0o755)
    for one in (model, folder / "weights", hidden):
        one.write_text("9")
    reads = "[one for one in sys.argv[1:] if os.access(one.partition('=')[2] or one, os.R_OK)]"
    words = [f"--model={model}", folder]
    assert found(tmp_path, reads, words) == str([f"--model={model}", str(folder)])
    assert found(tmp_path, f"pathlib.Path({str(hidden)!r}).read_text()") == "FileNotFoundError"
    named = {"files": [str(hidden)]}
    assert found(tmp_path, f"pathlib.Path({str(hidden)!r}).read_text()", **named) == "9"
    assert found(tmp_path, "sorted(os.listdir('.'))", [model]).startswith("[")


def test_relative_words_are_found(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("model").write_text("9")
    Path("other").write_text("8")
    assert found(tmp_path, "(open('model').read(), sorted(os.listdir()))", ["model"]) == (
        "('9', ['model', 'policy.py'])"
    )


@pytest.mark.parametrize(
    "place", ["/written", "/usr/written", "/dev/written", "/run/written", "/proc/sys/kernel/panic"]
)
def test_it_writes_nowhere(tmp_path, place, user):
    if os.getuid() == 0 and user == "as another user" and place.startswith("/proc"):
        return  # these files are root's
    told = found(tmp_path, f"open({place!r}, 'w').write('x')")
    assert told in ("OSError", "PermissionError", "FileNotFoundError")


def test_what_it_writes_in_its_folder_is_lost(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert found(tmp_path, "open('written', 'w').write('x')") in ("1", "PermissionError")
    assert sorted(one.name for one in tmp_path.iterdir()) == ["policy.py"]


def test_its_model_is_read_only(tmp_path):
    model = tmp_path / "model"
    model.write_text("9")
    model.chmod(0o666)
    assert found(tmp_path, "open(sys.argv[1], 'w')", [model]) in ("OSError", "PermissionError")
    assert model.read_text() == "9"


@pytest.mark.parametrize("place", ["/tmp", "/dev/shm"])
def test_its_disk_is_small_and_its_own(tmp_path, place):
    half = f"pathlib.Path('{place}', str(number)).write_bytes(bytes({DISK} // 2))"
    assert found(tmp_path, f"[{half} for number in range(3)]") == "OSError"
    assert found(tmp_path, f"open('{place}/large', 'wb').truncate({DISK} + 1)") == "OSError"
    assert found(tmp_path, f"open('{place}/small', 'w').write('x')") == "1"
    assert not Path(place, "small").exists()


def test_its_environment_is_empty(tmp_path, monkeypatch):
    monkeypatch.setenv("SECRET_OF_THE_AUDITOR", "1")
    names = "sorted(set(os.environ) - {'LC_CTYPE', 'PWD'})"
    assert found(tmp_path, names) == "['HOME', 'LANG', 'PATH']"


def test_it_has_no_rights(tmp_path, user):
    rights = "[one.split()[1] for one in open('/proc/self/status') if one.startswith('CapEff')]"
    assert found(tmp_path, rights) == "['0000000000000000']"
    if os.getuid() == 0 and user == "as this user":
        assert int(found(tmp_path, "os.getuid()")) >= 2_000_000_000


def test_it_has_limits(tmp_path):
    limits = "[resource.getrlimit(one)[1] for one in (resource.RLIMIT_AS, resource.RLIMIT_CORE)]"
    more = {"limits": Limits(HANG, HANG, GIB)}
    assert found(tmp_path, limits, **more) == str([GIB, 0])


def test_its_processes_are_few(tmp_path, monkeypatch, user):
    """With a limit of 20, of which the sandbox has some; root in a namespace has no limit."""
    if os.getuid() == 0 and user == "as another user":
        return
    monkeypatch.setattr(isolation, "PROCESSES", 20)
    forks = f"[os.fork() or time.sleep({LONGER}) for _ in range(40)]"
    assert found(tmp_path, forks) == "BlockingIOError"


def running(marker):
    """Processes of the machine with a word in their command."""
    found = []
    for one in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):  # it has ended since
            found += [one] if marker.encode() in one.read_bytes() else []
    return found


def test_nothing_that_it_starts_survives(tmp_path):
    marker = f"{LONGER}{os.getpid()}"
    daemon = f"subprocess.Popen(['sleep', '{marker}'], start_new_session=True)"
    what = f"({daemon}, time.sleep({LONGER}))"
    late = pytest.raises(UserError, match="did not answer within 1 s")
    with started(tmp_path, what, limits=Limits(HANG, 1.0)) as loaded, late:
        loaded.policy.predict(OBSERVATIONS)
    wait_until(lambda: not running(marker))


PARENT = f"""
import sys, time
from socialiq.policies.load import load_policy
from socialiq.isolation import isolation_of
load_policy("process:" + sys.argv[1], 2, 3, isolation=isolation_of("required"))
print("loaded", flush=True)
time.sleep({LONGER})
"""


def test_it_dies_with_its_parent(tmp_path):
    marker = f"{LONGER + 1}{os.getpid()}"
    policy = tmp_path / "policy.py"
    start = f"import subprocess\nsubprocess.Popen(['sleep', '{marker}'], start_new_session=True)\n"
    policy.write_text(start + POLICY.replace("WHAT", "0"))
    command = shlex.join([sys.executable, "-I", "-S", str(policy)])
    with subprocess.Popen(
        [sys.executable, "-c", PARENT, command], stdout=subprocess.PIPE
    ) as parent:
        assert parent.stdout is not None and parent.stdout.readline() == b"loaded\n"
        assert running(marker)
        parent.kill()
    wait_until(lambda: not running(marker))


CODE = """
import numpy as np
from pathlib import Path

WEIGHTS = np.load(Path(__file__).with_name("weights.npy"))


def policy(observations):
    return (observations @ WEIGHTS).argmax(axis=1)


def looks(observations):
    raise ValueError(sorted(one.name for one in Path(__file__).parent.iterdir()))


def imports(observations):
    import socialiq.nn.q_policy

    return [1 for _ in observations]
"""


def test_python_needs_no_permission(tmp_path):
    np.save(tmp_path / "weights.npy", np.float32([[1, 2, 3], [3, 1, 2]]))
    (tmp_path / "theirs.py").write_text(CODE)
    (tmp_path / "hidden").write_text("9")
    name, more = f"python:{tmp_path / 'theirs.py'}", {"files": [str(tmp_path / "weights.npy")]}
    isolated = {"isolation": isolation_of("required"), **more}
    with (
        load_policy(f"{name}:policy", 2, 3, **isolated) as there,
        load_policy(f"{name}:policy", 2, 3, allow_code=True) as here,
    ):
        expected = here.policy.predict(OBSERVATIONS)[0]
        np.testing.assert_array_equal(there.policy.predict(OBSERVATIONS)[0], expected)
        assert there.record.isolation.kind.startswith("bubblewrap")
    sees = pytest.raises(UserError, match=r"\['theirs.py', 'weights.npy'\]")
    with load_policy(f"{name}:looks", 2, 3, **isolated) as loaded, sees:
        loaded.policy.predict(OBSERVATIONS)
    library = pytest.raises(UserError, match=r"ModuleNotFoundError: No module named 'socialiq\.nn'")
    with load_policy(f"{name}:imports", 2, 3, **isolated) as loaded, library:
        loaded.policy.predict(OBSERVATIONS[:2])
    with pytest.raises(UserError, match=r"FileNotFoundError.*weights\.npy"):
        load_policy(f"{name}:policy", 2, 3, isolation=isolation_of("required"))


def test_nothing_tells_that_it_is_watched(tmp_path):
    told = found(tmp_path, "(dict(os.environ), os.listdir('/'), sys.argv)")
    assert not [word for word in ("bwrap", "socialiq", "launch", "enter", "USER") if word in told]
    assert found(tmp_path, "open('/proc/1/cmdline').read()") == "PermissionError"


@pytest.mark.parametrize(
    "call",
    [
        "fcntl.flock(open(PLACE), fcntl.LOCK_EX)",
        "fcntl.lockf(open(PLACE), fcntl.LOCK_SH)",
        "fcntl.fcntl(open(PLACE), fcntl.F_SETLEASE, fcntl.F_RDLCK)",
        "fcntl.fcntl(os.open('/usr', 0), fcntl.F_NOTIFY, 1)",
        "os.posix_fadvise(os.open(PLACE, 0), 0, 0, os.POSIX_FADV_DONTNEED)",
        "os.preadv(os.open(PLACE, 0), [bytearray(1)], 0, os.RWF_NOWAIT)",
        "1 + libc.inotify_init1(0)",
        "1 + libc.syscall(250, 0, -3, 1)",
        "1 + libc.syscall(425, 8, bytes(120))",
    ],
)
@pytest.mark.parametrize("place", ["'/usr/bin/env'", "'/dev/null'", "sys.argv[0]"])
def test_it_can_not_talk_to_another_over_a_file_that_both_read(tmp_path, call, place):
    """Attack: a second process, which is asked the same again, learned so what the first knew."""
    if "PLACE" not in call and place != "sys.argv[0]":
        return
    setting = f"[libc := __import__('ctypes').CDLL(None), fcntl := __import__('fcntl'), {call}][2]"
    told = found(tmp_path, setting.replace("PLACE", place))
    assert told in ("OSError", "PermissionError", "0")


MEET = """
import ctypes, os, threading, time
libc = ctypes.CDLL(None, use_errno=True)
x86 = os.uname().machine == "x86_64"
futex, thread_exit, end_of_thread = (202, 60, 218) if x86 else (98, 93, 96)
libc.mmap.restype = ctypes.c_void_p
libc.mmap.argtypes = [ctypes.c_void_p, *4 * [ctypes.c_long], ctypes.c_long]
page = ctypes.c_void_p(libc.mmap(None, 4096, 1, 1, os.open("/usr/bin/env", 0), 0))
seen = ctypes.c_uint32.from_address(page.value)
until = time.monotonic() + 2.0
told = 0
"""
"""Two processes map one file of the system, whose words they can't change."""

WAITS = """
seconds = (ctypes.c_long * 2)(2, 0)
while time.monotonic() < until and not told:
    told = int(libc.syscall(futex, page, COMMAND, seen, seconds, None, -1) == 0)
"""

WAKES = """
while time.monotonic() < until and not told:
    told = libc.syscall(futex, page, 1, 9, None, None, 0)
"""

ENDS = """
def end():
    libc.syscall(end_of_thread, page)
    libc.syscall(thread_exit, 0)
while time.monotonic() < until:
    threading.Thread(target=end, daemon=True).start()
    time.sleep(0.2)
"""


@pytest.mark.parametrize(
    ("command", "wakes"), [("0", WAKES), ("9", WAKES), ("9 + 256", WAKES), ("0", ENDS)]
)
def test_two_that_run_at_once_can_not_talk_by_a_page_of_memory(tmp_path, command, wakes):
    """Attack: a process of an audit waits by a futex in a file of the system; another wakes it."""

    def told(script):
        folder = tmp_path / str(len(script))
        folder.mkdir()
        (folder / "attack.py").write_text(MEET + script)
        return found(
            folder, "exec(open(sys.argv[1]).read(), globals()) or told", [folder / "attack.py"]
        )

    with ThreadPoolExecutor(2) as pool:
        both = list(pool.map(told, (WAITS.replace("COMMAND", command), wakes)))
    assert both == ["0", "0"]


def test_a_policy_has_one_process_at_a_time(tmp_path):
    """Attack: the first process lives as long as the audit, and tells each new one what it met."""
    marker = f"{LONGER + 2}{os.getpid()}"
    with started(tmp_path, "0", [marker]) as loaded:
        before = {one.parent.name for one in running(marker)}
        loaded.restart()
        after = {one.parent.name for one in running(marker)}
        assert before and after and not before & after
        with pytest.raises(UserError, match="found 0"):
            loaded.policy.predict(OBSERVATIONS)
    assert not running(marker)


def test_what_runs_is_what_was_hashed(tmp_path):
    """Attack: the weights are swapped after the commitment, and back before the second hash."""
    weights = tmp_path / "weights"
    weights.write_text("careful")
    with started(tmp_path, "open(sys.argv[1]).read()", [weights]) as loaded:
        weights.write_text("hasty")
        with pytest.raises(UserError, match="found careful"):
            loaded.policy.predict(OBSERVATIONS)


@pytest.mark.parametrize("mode", ["required", "none"])
def test_a_planted_compiled_file_is_not_run(tmp_path, mode):
    """Attack: a compiled file that names no source runs in place of the hashed one."""
    import importlib.util
    import marshal

    policy = tmp_path / "theirs.py"
    policy.write_text("def policy(observations):\n    return [2 for _ in observations]\n")
    planted = Path(importlib.util.cache_from_source(str(policy)))
    planted.parent.mkdir()
    code = compile("def policy(observations): return [1 for _ in observations]", "x", "exec")
    unchecked = importlib.util.MAGIC_NUMBER + (1).to_bytes(4, "little") + bytes(8)
    planted.write_bytes(unchecked + marshal.dumps(code))
    more = {"isolation": isolation_of(mode), "allow_code": True}
    with load_policy(f"python:{policy}:policy", 2, 3, **more) as loaded:
        assert loaded.policy.predict(OBSERVATIONS[:2])[0].tolist() == [2, 2]


def test_compiled_files_of_a_package_are_not_seen(tmp_path, monkeypatch):
    folder = tmp_path / "package_of_theirs"
    (folder / "__pycache__").mkdir(parents=True)
    (folder / "__pycache__" / "weights").write_text("not hashed")
    (folder / "__init__.py").write_text(
        "import pathlib\n\n\ndef policy(observations):\n"
        "    cache = pathlib.Path(__file__).with_name('__pycache__')\n"
        "    return [int(cache.exists()) for _ in observations]\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    more = {"isolation": isolation_of("required")}
    with load_policy("python:package_of_theirs:policy", 2, 3, **more) as loaded:
        assert loaded.policy.predict(OBSERVATIONS[:1])[0].tolist() == [0]
        loaded.check_unchanged()


def test_a_program_that_fails_says_why(tmp_path):
    script = tmp_path / "policy.sh"
    script.write_text("#!/no/such/interpreter\n")
    script.chmod(0o755)
    with pytest.raises(UserError, match=r"ended before it answered; last error line: .*No such"):
        load_policy(f"process:{script}", 2, 3, isolation=isolation_of("required"))
