import dataclasses
import signal

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.learners.callbacks import Callbacks, Report, Stopped
from socialiq.learners.dial.config import DialConfig, DialHyperparameters
from socialiq.learners.dial.train import train
from socialiq.worlds import registry

WORLD = registry.make_grid("crossing7").with_clock()
ONLINE = DialConfig(
    hidden=(8,), expert_batch=4, replay_batch=8, updates=60, environments=2, replay_capacity=50
)
OFFLINE = dataclasses.replace(ONLINE, online=False, scored="demonstrations", redraw_times=25)
RUNS = (DialHyperparameters(seed=0), DialHyperparameters(seed=1))


@pytest.fixture(name="data", scope="module")
def random_demonstrations(demonstrations):
    return demonstrations(n_features=7)


@pytest.fixture(name="whole", scope="module")
def uninterrupted(data):
    return train(ONLINE, RUNS, [data], WORLD, chunk=20)


def test_every_run_trains_soundly(whole):
    assert whole.failures == ()
    assert set(whole.history.values) == {"expert", "value", "prior", "multiplier", "max_q", "loss"}
    parts = [whole.history.array(name) for name in ("expert", "value", "prior")]
    np.testing.assert_allclose(np.sum(parts, axis=0), whole.history.array("loss"), rtol=1e-4)


def test_the_same_seed_gives_the_same_bits_and_another_does_not(whole, assert_same, data):
    again = train(ONLINE, RUNS, [data], WORLD, chunk=20)
    assert_same(again.networks, whole.networks)
    one, other = (whole.policy(run).at(45.0).weights[0] for run in (0, 1))
    assert not np.allclose(one, other)


def test_a_resumed_run_equals_an_uninterrupted_one_bit_for_bit(whole, assert_same, data, tmp_path):
    path = tmp_path / "state"

    def interrupt(report: Report) -> None:
        if report.done == 40:
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(Stopped, match="stopped after 40 of 60 updates"):
        around = Callbacks(interrupt, checkpoint=path)
        train(ONLINE, RUNS, [data], WORLD, callbacks=around, chunk=20)
    around = Callbacks(checkpoint=path, resume=True)
    resumed = train(ONLINE, RUNS, [data], WORLD, callbacks=around, chunk=20)
    assert_same(resumed.networks, whole.networks)
    changed = dataclasses.replace(ONLINE, margin=1.0)
    with pytest.raises(UserError, match="belongs to a run of other settings"):
        train(changed, RUNS, [data], WORLD, callbacks=around, chunk=20)


def test_a_dial_tells_how_it_was_made(whole):
    dial = whole.policy(1)
    assert (dial.low, dial.high) == (0.0, 90.0)
    assert dial.provenance["learner"] == "dial"
    assert DialHyperparameters(**dial.provenance["numbers"]) == RUNS[1]


def test_a_network_with_knots_covers_the_drawn_angles(data):
    static = dataclasses.replace(OFFLINE, knots=6, low=20.0, high=60.0, margin=5.0, updates=2)
    dial = train(static, RUNS[:1], [data], chunk=2).policy(0)
    assert dial.knots == pytest.approx((15.0, 25.0, 35.0, 45.0, 55.0, 65.0))
    assert dial.n_features == data.observation.shape[1]


@pytest.mark.slow
def test_offline_needs_no_world_and_without_demonstrations_no_data(data):
    assert train(OFFLINE, RUNS[:1], [data], chunk=60).failures == ()
    alone = dataclasses.replace(ONLINE, demonstrations=False)
    assert train(alone, RUNS[:1], [], WORLD, chunk=60).failures == ()


def test_what_doesnt_fit_is_refused_before_any_work(data, demonstrations):
    refused = {
        "no runs": (ONLINE, (), [data], WORLD),
        "no demonstrations": (ONLINE, RUNS, [], WORLD),
        "beyond the 1 given": (ONLINE, (DialHyperparameters(dataset=1),), [data], WORLD),
        "needs a world": (ONLINE, RUNS, [data], None),
        "takes no world": (OFFLINE, RUNS, [data], WORLD),
        "with a clock if it has one": (ONLINE, RUNS, [demonstrations(n_features=6)], WORLD),
    }
    for line, arguments in refused.items():
        with pytest.raises(UserError, match=line):
            train(*arguments)


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"low": 60.0, "high": 30.0}, "give the smaller first"),
        ({"low": 400.0, "high": 500.0}, "outside"),
        ({"margin": -1.0}, "margin must be 0 or more"),
        ({"knots": 1}, "knots: give 0, or at least 2"),
        ({"online": False, "demonstrations": False}, "nothing to learn from"),
        ({"demonstrations": False, "scored": "demonstrations"}, "choose all"),
        ({"updates": 0}, "updates must be at least 1"),
        ({"hidden": (0,)}, "hidden must be widths"),
        ({"view": "round"}, "unknown value of --set view"),
    ],
)
def test_structures_that_make_no_run_are_refused(changes, line):
    with pytest.raises(UserError, match=line):
        dataclasses.replace(DialConfig(), **changes)


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"temperature": 0.0}, "temperature must be above 0"),
        ({"prior_weight": float("nan")}, "prior_weight must be 0 or more"),
        ({"discount": 1.1}, "discount must lie in"),
        ({"seed": -1}, "seed must lie in"),
    ],
)
def test_numbers_outside_their_range_are_refused(changes, line):
    with pytest.raises(UserError, match=line):
        dataclasses.replace(DialHyperparameters(), **changes)
