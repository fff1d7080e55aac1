"""Answers of a policy, asked again."""

import contextlib
from types import SimpleNamespace

import numpy as np
import pytest

from socialiq.audit.evidence.consistency import (
    FEWEST_BATCHES,
    MOST_ROWS,
    SINGLE,
    Answers,
    Consistency,
    Recorder,
    joined,
)


class By:
    """A policy given by a function of a batch."""

    def __init__(self, function):
        self.function, self.sizes = function, []

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        batch = np.atleast_2d(observation)
        self.sizes.append(len(batch))
        chosen = np.asarray(self.function(batch))
        chosen = chosen if chosen.dtype.kind == "f" else chosen.astype(np.int64)
        return (chosen if np.ndim(observation) == 2 else chosen.squeeze(axis=0)), state


def honest(batch):
    return batch[:, 0] > 0


def started(policy):
    """Return what starts the process of a policy."""
    return lambda: contextlib.nullcontext(SimpleNamespace(policy=policy))


def recorded(policy, fresh=None, batches=6, rows=200):
    recorder, rng = Recorder(policy, started(fresh)), np.random.default_rng(0)
    for _ in range(batches):
        recorder.predict(rng.normal(size=(rows, 3)).astype(np.float32))
    return recorder


def test_an_honest_policy_is_consistent():
    fresh = By(honest)
    found = recorded(By(honest), fresh).check()
    assert found == ((1200, 0), (1200, 0), (SINGLE, 0)) and found.dependences(False) == []
    # The new process first meets single observations, then batches of other sizes.
    assert set(fresh.sizes[:SINGLE]) == {1}
    assert 200 not in fresh.sizes and sum(fresh.sizes[SINGLE:]) == 1200


def test_the_answers_are_passed_on():
    recorder = Recorder(By(lambda batch: batch[:, 0]), started(None))
    chosen, state = recorder.predict(np.array([[2.0], [1.0]], np.float32), "state")
    assert chosen.tolist() == [2, 1] and state == "state"
    assert recorder.predict(np.array([2.0], np.float32))[0] == 2


def test_observations_are_kept_as_they_were():
    recorder, batch = Recorder(By(honest), started(By(honest))), np.ones((10, 1), np.float32)
    recorder.predict(batch)
    batch[:] = -1.0
    assert recorder.check().repeated == (10, 0)


def counting(limit):
    asked = []

    def function(batch):
        asked.append(1)
        return honest(batch) if len(asked) <= limit else np.zeros(len(batch))

    return function


@pytest.mark.parametrize(
    ("ours", "fresh", "which"),
    [
        (counting(6), honest, ["the time or the number of requests"]),
        (honest, lambda batch: np.zeros(len(batch)), ["the batch, the order or the process"]),
        (honest, lambda batch: honest(batch) & (len(batch) > 1), ["the batch, the order or"]),
    ],
)
def test_what_the_answers_depend_on_is_told(ours, fresh, which):
    found = recorded(By(ours), By(fresh)).check().dependences(False)
    assert [one[: len(text)] for one, text in zip(found, which, strict=True)] == which


def test_each_block_has_a_new_process_and_the_first_meets_all_requests():
    first, later = By(honest), [By(lambda batch, n=n: np.full(len(batch), n)) for n in (5, 6)]
    waiting = iter(later)
    recorder = Recorder(first, lambda: started(next(waiting))())
    answers = []
    for rows in (3, 4, 5):
        with recorder.new_process():
            answers.append(recorder.predict(np.ones((rows, 1), np.float32))[0].tolist())
    assert answers == [[1] * 3, [5] * 4, [6] * 5]
    assert first.sizes == [3, 4, 5] and [one.sizes for one in later] == [[4], [5]]


@pytest.mark.parametrize(("shift", "differs"), [(0.0, False), (1e-6, False), (1e-3, True)])
def test_continuous_answers_may_differ_by_rounding_alone(shift, differs):
    asked = []

    def drifting(batch):
        asked.append(1)
        return np.tanh(batch[:, :2]) + np.float32(shift * (len(asked) > 6))

    found = recorded(By(drifting), By(lambda batch: np.tanh(batch[:, :2]))).check()
    assert found.repeated == (1200, 1200 * differs)
    assert found.shuffled == (1200, 0) and found.single == (SINGLE, 0)


def test_a_continuous_answer_by_the_row_is_told():
    def by_row(batch):
        return np.tanh(batch[:, :2] + np.arange(len(batch))[:, None]).astype(np.float32)

    assert "order" in recorded(By(by_row), By(by_row)).check().dependences(False)[0]


def test_a_rare_rounding_is_no_dependence():
    none = Answers(5000, 0)
    assert Consistency(none, Answers(5000, 5), none).dependences(False) == []
    assert Consistency(none, Answers(5000, 6), none).dependences(False) != []
    assert Consistency(none, none, Answers(999, 1)).dependences(False) != []
    assert Consistency(Answers(5000, 1), none, none).dependences(False) != []


def test_what_is_kept_is_spread_over_all_requests():
    policy = By(honest)
    recorder = recorded(policy, By(honest), batches=1000, rows=100)
    kept = recorder.check().repeated.queries
    assert MOST_ROWS / 2 <= kept <= MOST_ROWS
    large = recorded(By(honest), By(honest), batches=20, rows=MOST_ROWS)
    assert large.check().repeated.queries <= FEWEST_BATCHES * MOST_ROWS


def test_parts_are_summed_if_all_were_checked():
    one = Consistency(Answers(1, 0), Answers(2, 1), Answers(3, 2))
    assert joined([one, one]) == ((2, 0), (4, 2), (6, 4))
    assert joined([one, None]) is None and joined([]) is None


def test_a_report_reads_back():
    one = Consistency(Answers(1, 0), Answers(2, 1), Answers(3, 2))
    as_json = {name: answers._asdict() for name, answers in one._asdict().items()}
    assert Consistency.of(as_json) == one and Consistency.of(None) is None
