"""Answers of a policy, asked again."""

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


class Processes:
    """Processes of a policy, one after another; the last is not ended."""

    def __init__(self, *policies):
        self.waiting = list(policies)
        self.restart()

    def restart(self):
        self.now = self.waiting.pop(0) if len(self.waiting) > 1 else self.waiting[0]

    def predict(self, *asked, **how):
        return self.now.predict(*asked, **how)


def recorded(first, fresh=None, last=None, batches=6, rows=200):
    """A policy whose episodes one process drives; `fresh` is asked all again, `last` alone."""
    processes = Processes(first, fresh or first, last or fresh or first)
    recorder, rng = Recorder(processes, processes.restart), np.random.default_rng(0)
    for _ in range(batches):
        recorder.predict(rng.normal(size=(rows, 3)).astype(np.float32))
    return recorder


def test_an_honest_policy_is_consistent():
    first, fresh, last = By(honest), By(honest), By(honest)
    found = recorded(first, fresh, last).check()
    assert found == ((1200, 0), (1200, 0), (SINGLE, 0)) and found.dependences(False) == []
    # One meets every batch of the episodes, and then again.
    assert first.sizes == [200] * 6 and fresh.sizes == [200] * 12
    # The last one first meets single observations, then batches of other sizes.
    assert set(last.sizes[:SINGLE]) == {1}
    assert 200 not in last.sizes and sum(last.sizes[SINGLE:]) == 1200


def test_the_answers_are_passed_on():
    recorder = Recorder(By(lambda batch: batch[:, 0]), lambda: None)
    chosen, state = recorder.predict(np.array([[2.0], [1.0]], np.float32), "state")
    assert chosen.tolist() == [2, 1] and state == "state"
    assert recorder.predict(np.array([2.0], np.float32))[0] == 2


def test_observations_are_kept_as_they_were():
    recorder, batch = Recorder(By(honest), lambda: None), np.ones((10, 1), np.float32)
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
    ("fresh", "last", "which"),
    [
        (counting(6), honest, ["the time or the number of requests"]),
        (honest, lambda batch: np.zeros(len(batch)), ["the batch, the order or the process"]),
        (honest, lambda batch: honest(batch) & (len(batch) > 1), ["the batch, the order or"]),
    ],
)
def test_what_the_answers_depend_on_is_told(fresh, last, which):
    found = recorded(By(honest), By(fresh), By(last)).check().dependences(False)
    assert [one[: len(text)] for one, text in zip(found, which, strict=True)] == which


def test_one_process_is_asked_as_often_as_all_of_the_episodes():
    """Although not every batch is kept."""
    fresh = By(honest)
    recorded(By(honest), fresh, By(honest), batches=1000, rows=100).check()
    assert 1000 <= len(fresh.sizes) <= 1300


@pytest.mark.parametrize(("shift", "differs"), [(0.0, False), (1e-6, False), (1e-3, True)])
def test_continuous_answers_may_differ_by_rounding_alone(shift, differs):
    asked = []

    def drifting(batch):
        asked.append(1)
        return np.tanh(batch[:, :2]) + np.float32(shift * (len(asked) > 6))

    steady = By(lambda batch: np.tanh(batch[:, :2]))
    found = recorded(steady, By(drifting), steady).check()
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
    recorder = recorded(By(honest), batches=1000, rows=100)
    kept = recorder.check().repeated.queries
    assert MOST_ROWS / 2 <= kept <= MOST_ROWS
    large = recorded(By(honest), batches=20, rows=MOST_ROWS)
    assert large.check().repeated.queries <= FEWEST_BATCHES * MOST_ROWS


def test_parts_are_summed_if_all_were_checked():
    one = Consistency(Answers(1, 0), Answers(2, 1), Answers(3, 2))
    assert joined([one, one]) == ((2, 0), (4, 2), (6, 4))
    assert joined([one, None]) is None and joined([]) is None


def test_a_report_reads_back():
    one = Consistency(Answers(1, 0), Answers(2, 1), Answers(3, 2))
    as_json = {name: answers._asdict() for name, answers in one._asdict().items()}
    assert Consistency.of(as_json) == one and Consistency.of(None) is None
