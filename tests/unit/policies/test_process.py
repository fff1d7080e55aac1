import json
import os
import resource
import shlex
import signal
import subprocess
import sys

import numpy as np
import pytest
from tests.patience import HANG, LONGER, is_running, pid_in, wait_until

from socialiq.errors import UserError
from socialiq.policies.load import load_policy
from socialiq.policies.process import GIB, Limits, limits_of

UNHURRIED = Limits(start=HANG, step=HANG)
OBSERVATIONS = np.random.default_rng(0).normal(size=(40, 2)).astype(np.float32)

# A well-behaved policy of two features and three actions; tests put other lines into it.
POLICY = """
import json, os, subprocess, sys, time
for line in sys.stdin:
    message = json.loads(line)
    if "protocol" in message:
        answer = {"protocol": "socialiq-policy", "version": 1, "features": 2, "actions": 3}
        #greeting
    else:
        rows = message["observations"]
        answer = {"id": message["id"], "actions": [int(row[0] > 0) for row in rows]}
        #request
    print(json.dumps(answer), flush=True)
"""


@pytest.fixture
def start(tmp_path):
    started = []

    def made(greeting="", request="", limits=UNHURRIED, source=POLICY):
        path = tmp_path / "policy.py"
        path.write_text(source.replace("#greeting", greeting).replace("#request", request))
        command = shlex.join([sys.executable, str(path)])
        started.append(load_policy(f"process:{command}", 2, 3, limits=limits))
        return started[-1]

    yield made
    for one in started:
        one.close()


def refused(match, act):
    with pytest.raises(UserError, match=match) as caught:
        act()
    assert "\n" not in str(caught.value) and "\x1b" not in str(caught.value)


def test_actions_are_the_processs(start):
    loaded = start('answer["name"] = "a \\x1b[31mname"')
    actions, _ = loaded.policy.predict(OBSERVATIONS)
    np.testing.assert_array_equal(actions, OBSERVATIONS[:, 0] > 0)
    assert loaded.policy.predict(OBSERVATIONS[0])[0] == int(OBSERVATIONS[0, 0] > 0)
    assert loaded.record.details["name"] == "a [31mname"
    assert loaded.record.kind == "process" and not loaded.record.soft


def test_numbers_arrive_to_the_last_bit(start):
    loaded = start(request='answer["actions"] = [int(row[0] == row[1]) for row in rows]')
    value = np.float32(1) / np.float32(3)
    same = np.array([[value, value], [value, np.nextafter(value, np.float32(1))]])
    assert loaded.policy.predict(same)[0].tolist() == [1, 0]


def test_batches_larger_than_a_pipe_are_sent(start):
    many = np.random.default_rng(1).normal(size=(20_000, 2)).astype(np.float32)
    loaded = start()
    np.testing.assert_array_equal(loaded.policy.predict(many)[0], many[:, 0] > 0)


def test_soft_is_told(start):
    loaded = start(request='answer["actions"] = [int(message["deterministic"])] * len(rows)')
    assert loaded.policy.predict(OBSERVATIONS[:1])[0].tolist() == [1]
    assert loaded.policy.predict(OBSERVATIONS[:1], deterministic=False)[0].tolist() == [0]


def test_hash_covers_the_files_of_the_command(start):
    first, again, other = start(), start(), start("pass")
    assert first.record.sha256 == again.record.sha256 != other.record.sha256


@pytest.mark.parametrize(
    ("greeting", "match"),
    [
        ('answer["version"] = 2', "does not speak socialiq-policy version 1"),
        ('del answer["protocol"]', "does not speak"),
        ('del answer["features"]', "does not give its numbers of features"),
        ('answer["actions"] = "3"', "does not give its numbers of features"),
        ('answer["actions"] = True', "does not give its numbers of features"),
        ('answer["features"] = 70', "takes 70 features and 3 actions, the world has 2 and 3"),
        ("answer = [1]", "not a JSON object"),
        ('print("[" * 4000); continue', "not JSON"),
        ('print("<script>alert(1)</script>"); continue', "not JSON"),
        ('answer["name"] = "x" * 5000', "answered more than 4,096 bytes"),
        ("raise SystemExit(3)", "ended before it answered"),
    ],
)
def test_greetings_that_are_none_are_refused(start, greeting, match):
    refused(match, lambda: start(greeting.replace("continue", "sys.stdout.flush(); continue")))


@pytest.mark.parametrize(
    ("request_", "match"),
    [
        ('answer["id"] = 7', "did not name the request 1"),
        ('answer["actions"] = 1', "not a list of integers"),
        ('answer["actions"] = [0.0] * len(rows)', "not a list of integers"),
        ('answer["actions"] = [True] * len(rows)', "not a list of integers"),
        ('answer["actions"] = [10**40] * len(rows)', "more than 32 bits"),
        ('answer["actions"] = [3] * len(rows)', "chose action 3"),
        ('answer["actions"] = [0]', "one integer for each of 40"),
        ("print(json.dumps(answer))", "one, after it has read it|did not name"),
        ('sys.stdout.write("x" * 10**7)', "answered more than 5,376 bytes"),
        (
            "1 / 0",
            "ended before it answered; last error line: ZeroDivisionError: division by zero",
        ),
    ],
)
def test_answers_that_are_none_are_refused(start, request_, match):
    policy = start(request=request_).policy

    def twice():
        policy.predict(OBSERVATIONS)
        policy.predict(OBSERVATIONS)

    refused(match, twice)


def test_last_words_are_shown_without_their_escapes(start):
    say = (
        'sys.stderr.write("first\\n" * 9999 + "\\x1b[2Jthe \\x00 model is\\tgone\\n"); sys.exit(1)'
    )
    refused("last error line: \\[2Jthe model is gone$", lambda: start(say))


def test_talkative_process_does_not_block(start):
    loaded = start(request='sys.stderr.write("x" * 300_000)')
    assert loaded.policy.predict(OBSERVATIONS)[0].shape == (40,)


@pytest.mark.parametrize(
    "what", [f"time.sleep({LONGER})", "while True: pass", "sys.stdin.readline()"]
)
def test_late_answer_ends_the_process(start, tmp_path, what):
    file = tmp_path / "pid"
    say = f'print(os.getpid(), file=open({str(file)!r}, "w"), flush=True)'
    loaded = start(say, what, UNHURRIED._replace(step=1.0))
    pid = pid_in(file)
    assert is_running(pid)
    refused("did not answer within 1 s", lambda: loaded.policy.predict(OBSERVATIONS))
    wait_until(lambda: not is_running(pid))
    refused("did not answer within 1 s", lambda: loaded.policy.predict(OBSERVATIONS))


def test_process_that_does_not_read_is_late(start):
    deaf = f"import time\ntime.sleep({LONGER})"
    refused("did not answer within 0.3 s", lambda: start(source=deaf, limits=Limits(0.3, 1.0)))


def test_what_it_has_started_ends_with_it(start, tmp_path):
    file = tmp_path / "pid"
    spawn = f'child = subprocess.Popen(["sleep", "{LONGER}"]); '
    loaded = start(spawn + f'print(child.pid, file=open({str(file)!r}, "w"), flush=True)')
    pid = pid_in(file)
    assert is_running(pid)
    loaded.close()
    wait_until(lambda: not is_running(pid))
    loaded.close()
    refused("was ended", lambda: loaded.policy.predict(OBSERVATIONS))


PARENT = f"""
import os, sys, time
from socialiq.policies.load import load_policy
load_policy("process:" + sys.argv[1], 2, 3)
print("loaded", flush=True)
time.sleep({LONGER})
"""


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
def test_it_dies_with_its_parent(tmp_path, how):
    file, policy = tmp_path / "pid", tmp_path / "policy.py"
    say = f'print(os.getpid(), file=open({str(file)!r}, "w"), flush=True)'
    policy.write_text(POLICY.replace("#greeting", say))
    parent = subprocess.Popen(
        [sys.executable, "-c", PARENT, shlex.join([sys.executable, str(policy)])],
        stdout=subprocess.PIPE,
    )
    with parent:
        try:
            assert parent.stdout is not None and parent.stdout.readline() == b"loaded\n"
            pid = pid_in(file)
            assert is_running(pid)
            os.kill(parent.pid, how)
            wait_until(lambda: not is_running(pid))
        finally:
            parent.kill()


def test_no_shell_reads_the_command(tmp_path):
    touched = tmp_path / "touched"
    refused(
        "not JSON", lambda: load_policy(f"process:echo '$(touch {touched})'; touch {touched}", 2, 3)
    )
    assert not touched.exists()


@pytest.mark.parametrize("command", ["", "no-such-program-here", "'unclosed", "\x1b[31m"])
def test_command_must_be_one(command):
    refused(
        "no such program|cannot read the command", lambda: load_policy(f"process:{command}", 2, 3)
    )


def test_example_answers(crafted):
    script = crafted.examples / "process_policy.py"
    command = shlex.join([sys.executable, "-I", "-S", str(script)])
    observation = np.zeros(70, np.float32)
    near = observation.copy()
    near[[7, 8]] = [1.0, 0.1]  # a vehicle at 10 m
    with load_policy(f"process:{command}", 70, 3) as loaded:
        assert loaded.policy.predict(np.stack([observation, near]))[0].tolist() == [2, 0]
        assert json.dumps(loaded.record.as_json())


def asked(loaded):
    return loaded.policy.predict(OBSERVATIONS)


def test_a_hungry_process_ends_and_says_why(start):
    """It asks for 2 GiB, of 1 GiB that it may have."""
    loaded = start(request="held = bytearray(2 * 1024**3)", limits=UNHURRIED._replace(memory=GIB))
    refused("ended before it answered; last error line: MemoryError", lambda: asked(loaded))
    refused("ended before it answered", lambda: asked(loaded))


def test_all_that_a_process_starts_has_the_same_limit(start):
    told = (
        "words = 'import resource as r; print(*r.getrlimit(r.RLIMIT_AS))'; "
        "found = subprocess.run([sys.executable, '-c', words], capture_output=True, text=True); "
        "answer['name'] = found.stdout.strip()"
    )
    assert start(told, limits=UNHURRIED._replace(memory=GIB)).record.details["name"] == (
        f"{GIB} {GIB}"
    )
    ours = " ".join(str(one) for one in resource.getrlimit(resource.RLIMIT_AS))
    assert start(told, limits=UNHURRIED._replace(memory=0)).record.details["name"] == ours


@pytest.mark.parametrize(
    ("limits", "match"),
    [
        (Limits(memory=1000), "memory must be from 0.25"),
        (Limits(memory=-1), "memory must be from 0.25"),
        (Limits(step=0.0), "seconds for an answer must be"),
        (Limits(start=float("nan")), "seconds for an answer must be"),
    ],
)
def test_limits_that_are_none(start, limits, match):
    refused(match, lambda: start(limits=limits))


def test_limits_of_the_command_line():
    assert limits_of(2.5, 0.5) == Limits(step=2.5, memory=GIB // 2)
    assert limits_of(5.0, 8.0) == Limits()
    for memory in (float("nan"), float("inf"), -1.0):
        refused("memory in GiB must be at least 0", lambda memory=memory: limits_of(5.0, memory))


# Two features, actions of two numbers.
VECTORS = """
import json, sys
for line in sys.stdin:
    message = json.loads(line)
    if "protocol" in message:
        answer = {**message}
        #greeting
    else:
        one = [0.25, -1]
        #request
        answer = {"id": message["id"], "actions": [one for row in message["observations"]]}
    print(json.dumps(answer), flush=True)
"""


@pytest.fixture
def answering(tmp_path):
    started = []

    def made(request="", greeting="", n_actions=0, action_size=2):
        path = tmp_path / "policy.py"
        path.write_text(VECTORS.replace("#greeting", greeting).replace("#request", request))
        command = shlex.join([sys.executable, str(path)])
        more = {"action_size": action_size, "limits": UNHURRIED}
        started.append(load_policy(f"process:{command}", 2, n_actions, **more))
        return started[-1]

    yield made
    for one in started:
        one.close()


def test_a_process_answers_continuous_actions(answering):
    with answering() as loaded:
        actions, _ = loaded.policy.predict(OBSERVATIONS)
        assert actions.dtype == np.float32 and actions.tolist() == [[0.25, -1.0]] * 40
        assert loaded.record.as_json()["action_size"] == 2
        assert "n_actions" not in loaded.record.as_json()


@pytest.mark.parametrize(
    ("request_line", "match"),
    [
        ("one = ['0.25', '0.5']", 'answered "0.25" in an action: each must be a number'),
        ("one = [True, 0.0]", "answered true in an action"),
        ("one = [None, 0.0]", "answered null"),
        ("one = [float('nan'), 0.0]", r"answered nan in an action: .* \[-1, 1\]"),
        ("one = [0.0, float('-inf')]", "answered -inf"),
        ("one = [0.0, 1.01]", "answered 1.01"),
        ("one = [0.0, 10**30]", "answered 1000"),
        ("one = [0.0]", r"no list of 2 number\(s\) for each"),
        ("one = 0", "no list of 2"),
        ("one = [[0.0], [0.0]]", "each must be a number"),
        ("message['observations'].pop()", r"shape \(39, 2\): it must be 2 numbers for each of 40"),
    ],
)
def test_an_answer_that_is_no_vector_is_refused(answering, request_line, match):
    loaded = answering(request_line)
    refused(match, lambda: loaded.policy.predict(OBSERVATIONS))


@pytest.mark.parametrize(
    ("greeting", "match"),
    [
        ("answer = {**message, 'actions': 3}", "does not give its numbers"),
        ("answer.pop('action_size')", "does not give its numbers"),
        ("answer['action_size'] = '2'", "does not give its numbers"),
        ("answer['action_size'] = 3", "actions of 3 numbers, the world has 2 and actions of 2"),
        ("answer['actions'] = answer.pop('action_size') + 1", "takes 2 features and 3 discrete"),
    ],
)
def test_a_program_names_one_kind_of_actions(answering, greeting, match):
    refused(match, lambda: answering(greeting=greeting))


def test_a_program_of_continuous_actions_does_not_fit_a_discrete_world(answering):
    swapped = "answer['action_size'] = answer.pop('actions')"
    refused("the world has 2 and 3 discrete", lambda: answering("", swapped, 3, 0))
