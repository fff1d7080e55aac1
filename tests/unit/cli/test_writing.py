"""Outputs when the disk is full, when two processes want one place, and after Ctrl-C."""

import contextlib
import dataclasses
import gc
import json
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from tests.fuzz.calls import BASES, DATA, LONG, OUT, POLICY, PROFILE, TRAINING
from tests.fuzz.samples import SWEEP, _trajectories, make_stakeholders
from tests.patience import HANG, wait_until

from socialiq.cli.commands import COMMANDS, command_class
from socialiq.cli.main import ctrl_c_until_heard, main
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_policy import QPolicy

XML = Path(__file__).parents[3] / "examples" / "recordings" / "ZAM_Crossing-1_1_T-1.xml"


@contextlib.contextmanager
def full_disk():
    """Let no file grow above 10 bytes, as on a disk that is full."""
    resource = pytest.importorskip("resource", reason="needs Linux or macOS")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.fixture(scope="module", name="ok")
def samples(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ok")
    shapes = [(3, 4), (2, 3)]
    weights = tuple(np.zeros(shape, np.float32) for shape in shapes)
    biases = tuple(np.zeros(shape[0], np.float32) for shape in shapes)
    QPolicy(weights, biases, "relu", 1.0).save(folder / "policy.safetensors")
    wide = np.zeros((3, 6), np.float32), np.array([[1, 0, 0], [0, 1, 0]], np.float32)
    wide[0][0, -2], wide[0][1, -1] = 1.0, 1.0  # (cos α, sin α)
    turned = QPolicy(wide, biases, "relu", 1.0)
    DialPolicy(turned, 0.0, 90.0).save(folder / "dial.safetensors")
    new = ["profile", "new", "--world", "crossing5", "--angle", "0"]
    assert main([*new, "--out", str(folder / "profile.toml")]) == 0
    data = str(folder / "steps.safetensors")
    assert main(["collect", "crossing5", "--episodes", "1", "--out", data]) == 0
    assert main(["data", "to-arrays", data, "--out", str(folder / "steps.npz")]) == 0
    _trajectories(folder / "rollouts.npz")
    (folder / "sweep.toml").write_text(SWEEP)
    make_stakeholders(folder)
    shutil.copy(XML, folder / "recording.xml")
    assert main(["data", "import", "commonroad", str(XML), "--out", str(folder / "in")]) == 0
    (imported,) = (folder / "in").glob("*.safetensors")
    imported.rename(folder / "recording.safetensors")
    return folder


AUDIT = ["--profile", PROFILE, "--episodes", "20", "--out", OUT]
WRITING = {name: words for name, words in BASES.items() if OUT in " ".join(words)} | {
    "dial": [*BASES["dial"], "--calibrated", OUT],
    "page": ["--out", OUT],
    "audit": [POLICY, *AUDIT],
}
CALLS = [[*name.split(), *words] for name, words in WRITING.items()]
"""A call of each command that writes."""
MORE = [
    f"data to-arrays {DATA} --out {OUT}.csv",
    f"export {POLICY} --format torch --out {OUT}",
    f"export {POLICY} --format card --out {OUT}",
    f"export {POLICY} --format bom --out {OUT}",
    f"audit {POLICY} {' '.join(AUDIT)} --no-log",
]
LATE = (*TRAINING, *LONG, "data conflicts", "data census")
"""Commands that work for seconds before they write."""
LACKING = ("train improve-dial", "train td3-bc", "train own", "train practised-dial")
LACKING += ("data from-minari", "population intersection", "plot stops", "plot sweep")
"""Commands of which the tests lack a sample."""


def quick_or_slow(words):
    late = " ".join(words[:2]).startswith(LATE) or words[1] in ("world", "demonstrations")
    with_extra = "to-minari" in words or "onnx" in words
    marks = [pytest.mark.slow] if late or with_extra else []  # `make test` has no extras
    return pytest.param(words, id=" ".join(words[:2]), marks=marks)


def at(words, ok, out, place=OUT):
    replaced = (
        [place if word.startswith(OUT) else word for word in words] if place != OUT else words
    )
    return [word.replace("{ok}", str(ok)).replace("{out}", str(out)) for word in replaced]


def test_every_command_that_writes_is_called():
    called = {" ".join(words[:length]) for words in CALLS for length in (1, 2)}
    for name in COMMANDS:
        fields = {field.name for field in dataclasses.fields(command_class(name))}
        assert name in called or not {"out", "calibrated"} & fields, name


@pytest.mark.parametrize(
    "words",
    [
        pytest.param(
            words,
            id=" ".join(words[:2]),
            marks=[pytest.mark.slow] if "to-minari" in words else [],
        )
        for words in CALLS
    ],
)
def test_a_name_of_another_format_is_refused_before_the_work(words, capsys, tmp_path, ok):
    assert main(at(words, ok, tmp_path, f"{tmp_path}/new.xlsx")) == 2
    line = capsys.readouterr().err
    assert ".xlsx" in line or " ".join(words[:2]) in LACKING, line
    assert line.count("\n") == 1 and not list(tmp_path.iterdir())


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    "words",
    [
        quick_or_slow(words)
        for words in (*CALLS, *map(str.split, MORE))
        if " ".join(words[:2]) not in LACKING
    ],
)
def test_a_full_disk_is_one_line_and_leaves_nothing(words, capsys, tmp_path, ok):
    with full_disk():
        status = main(at(words, ok, tmp_path))
    said = capsys.readouterr()
    assert status == 2 and said.out == "" and "File too large" in said.err, said.err[-3000:]
    lines = [line for line in said.err.splitlines() if "File too large" in line]
    assert len(lines) == 1 and said.err.endswith(f"{lines[0]}\n")
    left = [path for path in tmp_path.rglob("*") if path.is_file() and path.stat().st_size]
    assert not left


@pytest.mark.filterwarnings("ignore")
def test_a_full_disk_leaves_the_old_content(capsys, tmp_path, ok):
    out = tmp_path / "profile.toml"
    new = ["profile", "new", "--world", "crossing5", "--angle", "0", "--out", str(out)]
    assert main(new) == 0
    before = out.read_bytes()
    with full_disk():
        assert main([*new, "--replace"]) == 2
    assert out.read_bytes() == before and len(list(tmp_path.iterdir())) == 1
    assert "cannot write" in capsys.readouterr().err


def started(*words) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "socialiq", *map(str, words)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["file", "folder"])
def test_two_processes_with_one_output_never_lose_a_result(tmp_path, ok, kind):
    out = tmp_path / "out"
    words = {
        "file": ["collect", "crossing5", "--episodes", "200", "--json"],
        "folder": ["audit", ok / "policy.safetensors", "--profile", ok / "profile.toml"],
    }[kind]
    words += [] if kind == "file" else ["--episodes", "200", "--no-log", "--json"]
    running = [started(*words, "--seed", seed, "--out", out) for seed in range(4)]
    ends = [(one.communicate(timeout=HANG), one.returncode) for one in running]
    accepted = (0,) if kind == "file" else (0, 1, 3)
    done = [json.loads(said[0]) for said, status in ends if status in accepted]
    assert len(done) == 1
    for (_, error), status in ends:
        refused = "another process is writing" in error or "exists already" in error
        assert status in accepted or (status == 2 and refused)
    if kind == "folder":
        assert json.loads((out / "report.json").read_text())["seeds"] == done[0]["seeds"]
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_ctrl_c_is_heard_though_a_library_drops_it():
    def drop(*_):
        if not callbacks_done:
            callbacks_done.append(True)
            signal.raise_signal(signal.SIGINT)
            time.sleep(0.01)

    callbacks_done = []
    gc.callbacks.append(drop)
    try:
        with pytest.raises(KeyboardInterrupt), ctrl_c_until_heard():
            gc.collect()
            assert callbacks_done
            with contextlib.suppress(BaseException):  # as JAX has it
                wait_until(lambda: False)
            try:
                wait_until(lambda: False)
            finally:
                time.sleep(1.5)  # what a command still does is not interrupted
                callbacks_done.append("finished")
    finally:
        gc.callbacks.remove(drop)
    assert "finished" in callbacks_done
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.slow
@pytest.mark.parametrize("command", ["collect", "audit"])
def test_ctrl_c_leaves_nothing(tmp_path, monkeypatch, ok, command):
    cache, place = tmp_path / "cache", tmp_path / "place"
    place.mkdir()
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache))
    words = {
        "collect": ["collect", "crossing7", "--episodes", "900000"],
        "audit": ["audit", ok / "policy.safetensors", "--profile", ok / "profile.toml", "--no-log"],
    }[command]
    words += ["--episodes", "900000"] if command == "audit" else []
    process = started(*words, "--out", place / "out")
    wait_until(lambda: list(cache.rglob("*.claim")))  # it has claimed its output
    time.sleep(1.0)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=HANG)
    # Python ends by the signal itself if Ctrl-C came while it compiled a text, as `dataclass` does.
    assert process.returncode in (130, -signal.SIGINT), errors
    assert errors.endswith("socialiq: stopped; nothing was saved\n")
    assert list(place.iterdir()) == []
