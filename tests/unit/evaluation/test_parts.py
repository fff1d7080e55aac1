"""Parts of episodes in processes of their own: order, failures, and their end."""

import os
import time
from functools import partial

import pytest
from tests.patience import LONGER, is_running, pid_in, wait_until

from socialiq.errors import UserError
from socialiq.evaluation.parts import blocks_of, in_parts


def square(number):
    return number * number


def fail(number, pid):
    """0 sleeps, and the others fail meanwhile."""
    if number == 0:
        pid.write_text(f"{os.getpid()}\n")
        time.sleep(LONGER)
        pid.with_name("slept").touch()
    pid_in(pid)
    if number == 1:
        raise ValueError("no\nsuch number")
    if number == 2:
        raise UserError("choose another")
    os._exit(9)


def test_blocks_are_the_seeds_in_order():
    blocks = blocks_of(range(3, 14), 2)
    assert len(blocks) == 8
    assert [seed for block in blocks for seed in block.tolist()] == [*range(3, 14)]
    assert len(blocks_of(range(2), 5)) == 2


@pytest.mark.slow
def test_results_are_in_order_and_progress_is_reported():
    reports = []
    assert in_parts(square, range(5), 2, reports.append) == [0, 1, 4, 9, 16]
    assert [report.done for report in reports] == [1, 2, 3, 4, 5]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "line"),
    [(1, "failed: ValueError: no such number"), (2, "^choose another$"), (3, "was killed")],
)
def test_a_failed_part_is_one_line_and_ends_the_others(tmp_path, number, line):
    pid = tmp_path / "pid"
    with pytest.raises(UserError, match=line) as error:
        in_parts(partial(fail, pid=pid), [0, number], 2)
    assert "\n" not in str(error.value)
    wait_until(lambda: not is_running(pid_in(pid)))
    assert not (tmp_path / "slept").exists()
