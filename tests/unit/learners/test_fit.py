"""`fit` with a learner that can be worked out: x follows its run's target, with noise."""

import dataclasses
import signal
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.learners import callbacks as callbacks_module
from socialiq.learners import fit
from socialiq.learners.callbacks import Callbacks, Report, Stopped
from socialiq.learners.state import History, HyperparameterArrays, Runs

TOTAL, NEVER = 40, 10_000


class Toy(NamedTuple):
    """Numbers of a run: where x goes, and when which of its values breaks."""

    target: Any
    breaks_at: Any
    breaks: Any  # 0: the term "noise", 1: the term "square", 2: x itself


def toys(*targets: float, breaks_at: tuple[int, ...] = (), breaks: int = 1) -> Toy:
    never = (NEVER,) * (len(targets) - len(breaks_at))
    return Toy(
        jnp.array(targets),
        jnp.array([*breaks_at, *never]),
        jnp.full(len(targets), breaks),
    )


class Follower(eqx.Module):
    """x moves to the run's target."""

    def initialise(self, hyperparameters: Toy) -> tuple[Any, Any]:
        key = jax.random.key(jnp.asarray(hyperparameters.target, jnp.uint32))
        return {"x": jnp.zeros(3)}, (key, jnp.zeros((), jnp.int32))

    def update(
        self, hyperparameters: Toy, state: Any, carry: Any
    ) -> tuple[Any, Any, dict[str, Any]]:
        key, step = carry
        key, one = jax.random.split(key)
        noise = 1e-3 * jax.random.normal(one, (3,))
        broken = jnp.where(step == hyperparameters.breaks_at, jnp.inf, 0.0)
        x = state["x"] + 0.2 * (hyperparameters.target - state["x"]) + noise
        x = x + jnp.where(hyperparameters.breaks == 2, broken, 0.0)
        terms = {
            "square": jnp.sum((hyperparameters.target - state["x"]) ** 2)
            + jnp.where(hyperparameters.breaks == 1, broken, 0.0),
            "noise": noise[0] + jnp.where(hyperparameters.breaks == 0, broken, 0.0),
        }
        return {"x": x}, (key, step + 1), terms


class Broken(Follower):
    """A follower whose only term is never a number."""

    def update(
        self, hyperparameters: Toy, state: Any, carry: Any
    ) -> tuple[Any, Any, dict[str, Any]]:
        return *super().update(hyperparameters, state, carry)[:2], {"a": jnp.asarray(jnp.nan)}


def train(
    hyperparameters: Toy,
    chunk: int = 10,
    total: int = TOTAL,
    fingerprint: str = "toy",
    **callbacks: Any,
) -> tuple[Runs, History]:
    around = Callbacks(**callbacks)
    return fit.fit(Follower(), hyperparameters, total, chunk, fingerprint, around)[:2]


def interrupt_after(done: int) -> Callable[[Report], None]:
    """A progress display under which the user presses Ctrl-C."""

    def on_report(report: Report) -> None:
        if report.done == done:
            signal.raise_signal(signal.SIGINT)

    return on_report


@pytest.fixture(name="whole", scope="module")
def uninterrupted():
    return train(toys(1.0, 5.0))


def assert_same_history(one: History, other: History) -> None:
    assert one.updates == other.updates
    assert one.values.keys() == other.values.keys()
    for name in one.values:
        np.testing.assert_array_equal(one.array(name), other.array(name))


def test_runs_converge_to_their_own_targets(whole):
    runs, history = whole
    np.testing.assert_allclose(runs.state["x"], [[1] * 3, [5] * 3], atol=0.01)
    assert runs.updates.tolist() == [TOTAL, TOTAL]
    assert runs.failed_at.tolist() == [-1, -1]
    assert history.updates == [10, 20, 30, 40]
    assert history.array("square").shape == (4, 2)


def test_the_history_holds_the_means_over_each_chunk(whole):
    """Without noise the distance shrinks by 0.8 at each update."""
    expected = [3 * np.mean(0.64 ** np.arange(start, start + 10)) for start in (0, 10)]
    np.testing.assert_allclose(whole[1].array("square")[:2, 0], expected, rtol=0.03)


@pytest.mark.parametrize("chunk", [1, 7, 40, 100])
def test_the_size_of_chunks_changes_nothing(whole, assert_same, chunk):
    assert_same(train(toys(1.0, 5.0), chunk=chunk)[0], whole[0])


def test_a_run_does_not_depend_on_its_neighbours(whole):
    alone, _ = train(toys(5.0))
    among, _ = train(toys(9.0, 5.0, 2.0, breaks_at=(3,)))
    for runs, run in ((alone, 0), (among, 1)):
        np.testing.assert_allclose(runs.state["x"][run], whole[0].state["x"][1], atol=1e-5)


@pytest.mark.parametrize(("breaks", "term"), [(0, "noise"), (1, "square"), (2, "parameters")])
def test_a_run_that_breaks_keeps_its_last_sound_state(whole, assert_same, breaks, term):
    reports: list[Report] = []
    names = ("first", "second")
    hyperparameters = toys(1.0, 5.0, breaks_at=(20,), breaks=breaks)
    runs, _ = train(hyperparameters, on_report=reports.append, run_names=names)
    assert runs.failed_at.tolist() == [20, -1]
    before, _ = train(toys(1.0, 5.0), total=20)
    assert_same(runs.state["x"][0], before.state["x"][0])
    assert_same(runs.state["x"][1], whole[0].state["x"][1])
    assert [len(report.failures) for report in reports] == [0, 0, 1, 1]
    assert (
        reports[-1]
        .failures[0]
        .startswith(f"first stopped at update 20: {term} not finite; lower learning_rate")
    )


def test_a_run_without_a_name_is_called_by_its_number():
    reports: list[Report] = []
    train(toys(1.0, 5.0, breaks_at=(0, 0)), on_report=reports.append)
    assert [line[:13] for line in reports[-1].failures] == ["run 0 stopped", "run 1 stopped"]


@pytest.mark.parametrize(
    ("numbers", "lower"),
    [
        ((), "learning_rate"),
        (("strength",), "learning_rate or strength"),
        (("strength", "prior_weight"), "learning_rate, strength or prior_weight"),
    ],
)
def test_what_to_lower_is_what_the_learner_has(numbers, lower):
    one = np.zeros(1, np.int32)
    stopped = Runs(state=None, carry=None, updates=one, failed_at=one + 3, failed_term=one)
    arrays = HyperparameterArrays(dict.fromkeys(numbers, jnp.ones(1)))
    lines = fit.failure_lines(stopped, ("loss",), ("mine",), arrays)
    assert lines == (f"mine stopped at update 3: loss not finite; lower {lower}",)


@pytest.mark.parametrize("breaks", [0, 1, 2])
def test_a_run_that_breaks_amid_a_chunk_keeps_its_last_sound_state(assert_same, breaks):
    runs, history = train(toys(1.0, 5.0, breaks_at=(13,), breaks=breaks), chunk=10)
    before, _ = train(toys(1.0, 5.0), chunk=13, total=13)
    assert runs.failed_at.tolist() == [13, -1]
    assert runs.updates.tolist() == [TOTAL, TOTAL]
    assert_same(runs.state["x"][0], before.state["x"][0])
    assert np.isnan(history.array("square")[:, 0]).tolist() == [False, True, True, True]


def test_only_the_first_failure_is_told():
    always = fit.fit(Broken(), toys(1.0), TOTAL, 10, "toy", Callbacks())[0]
    assert (always.failed_at.tolist(), always.failed_term.tolist()) == ([0], [0])


def test_reports_and_history_leave_a_broken_run_out():
    reports: list[Report] = []
    hyperparameters = toys(100.0, 5.0, breaks_at=(3,))
    _, history = train(hyperparameters, on_report=reports.append)
    square = history.array("square")
    assert not np.isfinite(square[:, 0]).any()
    assert [report.terms["square"] for report in reports] == square[:, 1].tolist()


def test_reports_tell_progress_terms_and_what_the_monitor_saw():
    reports: list[Report] = []
    runs, history = train(
        toys(1.0, 5.0),
        on_report=reports.append,
        monitor=lambda state: {"x": np.asarray(state["x"][:, 0])},
    )
    assert [(report.done, report.total) for report in reports] == [
        (n, 40) for n in (10, 20, 30, 40)
    ]
    assert all(report.rate > 0 for report in reports)
    assert reports[0].seconds_left > reports[-1].seconds_left == 0
    assert reports[1].terms["square"] == pytest.approx(history.array("square")[1].mean())
    assert set(reports[1].terms) == {"square", "noise"}
    np.testing.assert_array_equal(reports[-1].monitored["x"], runs.state["x"][:, 0])
    np.testing.assert_array_equal(history.array("x")[-1], runs.state["x"][:, 0])


def test_the_rate_leaves_out_the_first_chunk_which_compiles(
    monkeypatch,
):
    now, reports = [0.0], []
    monkeypatch.setattr(callbacks_module.time, "monotonic", lambda: now[0])

    def monitor(state: Any) -> dict[str, np.ndarray]:
        now[0] += 2.0 if now[0] else 50.0
        return {}

    train(toys(1.0, 5.0), on_report=reports.append, monitor=monitor)
    assert [report.rate for report in reports] == [0.4, 10.0, 10.0, 10.0]  # of both runs
    assert [report.seconds_left for report in reports] == [150.0, 4.0, 2.0, 0.0]


@pytest.mark.parametrize("stops", [[10], [30], [10, 30]])
def test_a_resumed_run_equals_an_uninterrupted_one_bit_for_bit(whole, assert_same, tmp_path, stops):
    path = tmp_path / "state"
    for number, done in enumerate(stops):
        with pytest.raises(Stopped, match=f"stopped after {done} of 40 updates: go on with"):
            train(
                toys(1.0, 5.0),
                on_report=interrupt_after(done),
                checkpoint=path,
                resume=number > 0,
            )
    runs, history = train(toys(1.0, 5.0), checkpoint=path, resume=True)
    assert_same(runs, whole[0])
    assert_same_history(history, whole[1])


def test_a_broken_run_stays_broken_after_a_resume(assert_same, tmp_path):
    hyperparameters, path = toys(1.0, 5.0, breaks_at=(3,)), tmp_path / "state"
    with pytest.raises(Stopped):
        train(hyperparameters, on_report=interrupt_after(20), checkpoint=path)
    resumed, history = train(hyperparameters, checkpoint=path, resume=True)
    whole, whole_history = train(hyperparameters)
    assert_same(resumed, whole)
    assert_same_history(history, whole_history)


def test_a_run_that_is_resumed_at_its_end_still_names_what_broke(tmp_path):
    runs, history = train(toys(1.0, 5.0, breaks_at=(13,)))
    fit.save_checkpoint(tmp_path / "state", "toy", runs, history)
    callbacks = Callbacks(checkpoint=tmp_path / "state", resume=True)
    *_, lines = fit.fit(Follower(), toys(1.0, 5.0), TOTAL, 10, "toy", callbacks)
    assert lines == ("run 0 stopped at update 13: square not finite; lower learning_rate",)


def test_before_chunk_is_told_the_updates_done_and_changes_the_runs():
    told = []

    def reset(runs: Runs, done: int) -> Runs:
        told.append(done)
        return runs._replace(state=jax.tree.map(jnp.zeros_like, runs.state))

    runs, *_ = fit.fit(Follower(), toys(1.0), 40, 10, "toy", Callbacks(), reset)
    assert told == [0, 10, 20, 30]
    np.testing.assert_allclose(runs.state["x"], 1 - 0.8**10, atol=0.01)


@pytest.fixture(name="saved")
def stopped_after_10(tmp_path):
    path = tmp_path / "state"
    with pytest.raises(Stopped):
        train(toys(1.0, 5.0), on_report=interrupt_after(10), checkpoint=path)
    return path


def test_a_checkpoint_of_another_run_is_refused(saved):
    with pytest.raises(UserError, match="belongs to a run of other settings or data"):
        train(toys(1.0, 5.0), fingerprint="other", checkpoint=saved, resume=True)


def test_a_damaged_or_missing_checkpoint_is_refused(saved):
    content = bytearray(saved.read_bytes())
    content[-20] ^= 1
    saved.write_bytes(content)
    with pytest.raises(UserError, match="damaged"):
        train(toys(1.0, 5.0), checkpoint=saved, resume=True)
    saved.unlink()
    with pytest.raises(UserError, match="no such file"):
        train(toys(1.0, 5.0), checkpoint=saved, resume=True)
    with pytest.raises(UserError, match="nothing to resume from"):
        train(toys(1.0, 5.0), resume=True)


def test_stopping_without_a_checkpoint_says_that_nothing_was_saved():
    with pytest.raises(Stopped, match="stopped after 20 of 40 updates; nothing was saved"):
        train(toys(1.0, 5.0), on_report=interrupt_after(20))


def test_a_stop_in_the_last_chunk_is_the_end_of_the_run(whole, assert_same, tmp_path):
    path = tmp_path / "state"
    runs, _ = train(toys(1.0, 5.0), on_report=interrupt_after(40), checkpoint=path)
    assert_same(runs, whole[0])
    again, history = train(toys(1.0, 5.0), checkpoint=path, resume=True)
    assert_same(again, whole[0])
    assert_same_history(history, whole[1])


def test_a_second_interrupt_stops_at_once_and_the_handler_comes_back():
    before = signal.getsignal(signal.SIGINT)
    twice = interrupt_after(10)

    def on_report(report: Report) -> None:
        twice(report)
        twice(report)

    with pytest.raises(KeyboardInterrupt):
        train(toys(1.0, 5.0), on_report=on_report)
    assert signal.getsignal(signal.SIGINT) is before


def test_a_run_outside_the_main_thread_leaves_signals_alone(whole, assert_same):
    results = []
    thread = threading.Thread(target=lambda: results.append(train(toys(1.0, 5.0))))
    thread.start()
    thread.join()
    assert_same(results[0][0], whole[0])


def test_checkpoints_are_written_about_once_a_minute(monkeypatch, tmp_path):
    now, path, written = [0.0], tmp_path / "state", []
    monkeypatch.setattr(callbacks_module.time, "monotonic", lambda: now[0])

    def on_report(report: Report) -> None:
        written.append(path.exists())
        path.unlink(missing_ok=True)
        now[0] += 35.0

    train(toys(1.0, 5.0), on_report=on_report, checkpoint=path)
    assert written == [False, False, True, False]
    assert path.exists()


@dataclasses.dataclass(frozen=True)
class Setting:
    rate: float = 0.5
    hidden: tuple[int, ...] = (8,)


def test_a_fingerprint_names_the_data_and_every_setting():
    table = {"a": np.arange(4), "b": np.ones(2)}
    same = {fit.fingerprint(table, Setting()), fit.fingerprint(dict(table), Setting(0.5, (8,)))}
    assert len(same) == 1
    others = [
        fit.fingerprint({"a": np.arange(4), "b": np.zeros(2)}, Setting()),
        fit.fingerprint(table, Setting(0.25)),
        fit.fingerprint(table, Setting(hidden=(8, 8))),
        fit.fingerprint(table, Setting(), Setting()),
    ]
    assert len(same | set(others)) == 5


@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="counts the maps of Linux")
def test_programs_are_released_before_the_memory_maps_run_out():
    def maps() -> int:
        return Path("/proc/self/maps").read_bytes().count(b"\n")

    compiled = jax.jit(lambda x: jnp.sin(x) @ x)
    for size in (3, 5, 7):
        compiled(jnp.ones((size, size))).block_until_ready()
    before = maps()
    fit.release_programs(most=before + 1000)
    assert compiled._cache_size() == 3
    fit.release_programs(most=0)
    assert compiled._cache_size() == 0 and maps() < before
