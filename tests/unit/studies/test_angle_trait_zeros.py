"""Zeros of dials: common scale, decisions by effect, families of dials with known answers."""

import dataclasses

import numpy as np
import pytest
from studies.angle_trait import zeros
from studies.angle_trait.common_scale import Realised, mean_of
from studies.angle_trait.config import DIAL, OTHER_DIAL
from studies.angle_trait.driving import Decided, Population, drive
from studies.angle_trait.ensemble import (
    Member,
    common_angle,
    common_grid,
    fit_dials,
    likeliest,
    merged,
)
from studies.angle_trait.zeros_config import PLAIN, Config
from studies.angle_trait.zeros_jobs import folder_of, plan

from socialiq.errors import UserError
from socialiq.nn.dial_policy import DialPolicy
from socialiq_lab.results import Results
from socialiq_lab.study import Context, silent
from socialiq_recordings.trait.policy_family import by_effect

ANGLES = np.linspace(0.0, 90.0, 10)


def realised(social):
    return Realised(ANGLES, np.zeros(10), np.asarray(social, np.float64))


def shifted(dial, by):
    """The same dial under other angles: it does at an angle what it did `by` degrees lower."""
    asked = np.arange(by, 90.1, 5.0)
    settings = ((0.0, 0.0), *((float(one), float(one - by)) for one in asked))
    return dataclasses.replace(dial, settings=settings)


@pytest.fixture(name="dial", scope="module")
def one_dial():
    return DialPolicy.load(DIAL)


@pytest.fixture(name="driven", scope="module")
def thirty_and_eighty(dial):
    """Eight drivers of a dial at 30 and at 75 degrees, four episodes each."""
    return drive(Population("dial", np.repeat([30.0, 75.0], 4), 0.0), dial, 4, 50_810_000)


def test_matched_angles_bring_others_as_much():
    steep, flat = realised(ANGLES / 30), realised(ANGLES / 60)
    np.testing.assert_allclose(flat.angle_of(steep.social_at(np.array([15.0, 45.0]))), [30, 90])
    assert flat.angle_of(np.array([-1.0, 9.0])).tolist() == [0.0, 90.0]


def test_a_fall_is_smoothed_away():
    rising = realised([0, 1, 2, 3, 5, 4, 6, 7, 8, 9]).rising
    assert (np.diff(rising) > 0).all()
    np.testing.assert_allclose(rising[4:6], 4.5, atol=1e-6)


def test_the_common_scale_of_a_dial_alone_is_its_own():
    one = realised(ANGLES**2)
    reference = mean_of([one])
    member = Member(DialPolicy.load(DIAL), one)
    np.testing.assert_allclose(common_angle(member, ANGLES, reference), ANGLES, atol=1e-6)
    np.testing.assert_allclose(common_grid(reference, 30.0), [0, 30, 60, 90])


def test_actions_of_one_effect_are_one_candidate():
    values = np.array([[[1.0], [3.0], [2.0]], [[1.0], [3.0], [2.0]]])
    found = by_effect(values, np.array([[0, 0, 2], [0, 1, 2]]))
    np.testing.assert_array_equal(found[0, :, 0], [3.0, -np.inf, 2.0])
    np.testing.assert_array_equal(found[1], values[1])


def test_merged_decisions_keep_their_probability():
    chance, same = np.array([[0.2, 0.3, 0.5]]), np.array([[0, 0, 2]])
    empty = np.zeros((1, 3))
    seen = np.zeros((1, 4), np.float32)
    one = Decided(np.zeros(1, np.int64), np.log(chance), empty, empty, np.array([1]), seen, same)
    found = merged(one)
    assert found.action.tolist() == [0]
    np.testing.assert_allclose(np.exp(found.log_base), [[0.5, 0.0, 0.5]], atol=1e-9)


def test_a_driver_is_likeliest_at_its_own_angle(dial, driven):
    found = likeliest(driven, 4, dial, np.array([0.0, 30.0, 60.0, 75.0, 90.0]))
    for name in ("likeliest", "by_action"):
        assert [row[name] for row in found] == [30.0] * 4 + [75.0] * 4


def test_a_dial_of_another_zero_is_put_where_it_brings_as_much(dial, driven):
    """A family that does at 20 degrees more what the driver does: its own angles are off by 20."""
    own = Realised.of(dial, 60, 50_811_000, step=15.0)
    other = shifted(dial, 20.0)
    its = Realised.of(other, 60, 50_811_000, step=15.0)
    driver = Member(dial, own)
    models = fit_dials(driven, 4, 4, [Member(other, its)], seed=0, step=10.0)
    found = models.angle.drivers.sum(axis=1) @ models.trait.value
    angle = np.repeat([30.0, 75.0], 4)[models.sample.identity]
    assert found[angle == 30.0].mean() == pytest.approx(50.0, abs=6.0)
    truth = common_angle(driver, angle, mean_of([its]))
    assert np.abs(found - truth).mean() < 8.0 < np.abs(found - angle).mean()


def test_an_uncertain_zero_widens_an_interval_to_that_of_a_normal_error():
    grid, chance = np.arange(0.0, 91.0, 5.0), np.zeros(19)
    chance[9] = 1.0
    narrow = zeros.widened(grid, chance, 0.0, 0.9)
    wide = zeros.widened(grid, chance, 10.0, 0.9)
    assert narrow.angle == wide.angle == 45.0
    deviation = np.hypot(10.0, 5.0 / np.sqrt(12.0))
    assert wide.high - wide.low == pytest.approx(2 * 1.645 * deviation, rel=0.01)
    assert narrow.high - narrow.low < 5.0
    assert zeros.widened(grid, chance, 90.0, 0.9)[1:] == (0.0, 90.0)


def test_the_spread_of_zeros_leaves_the_left_out_dial_out():
    rows = [
        {"driver": a, "model": b, "likeliest": 50.0, "matched": 50.0 - off}
        for a, b, off in (("1", "2", 3.0), ("2", "1", -4.0), ("1", "3", 90.0), ("3", "2", 90.0))
    ]
    assert zeros.zero_spread(rows, ["1", "2"]) == pytest.approx(np.sqrt(12.5))


def test_each_dial_is_left_out_of_its_own_family():
    config = Config(dials=(1, 2, 3))
    assert config.family_of("2") == ("1", "3")
    assert config.family_of(PLAIN) == ("1", "2", "3")
    jobs = {job.name: job for job in plan(config)}
    assert jobs["populations/25/2"].config.models == ("1", "3")
    for job in jobs.values():
        assert {*job.inputs} <= {*jobs}
    episodes = [
        (one.first, one.first + one.episodes * len(one.planted))
        for one in (job.config for job in jobs.values() if job.stage in ("zeros", "populations"))
    ]
    for (_, end), (begin, _) in zip(sorted(episodes), sorted(episodes)[1:], strict=False):
        assert end <= begin  # no episode is driven twice


@pytest.mark.parametrize(
    "wrong",
    [
        {"dials": (1, 2)},
        {"dials": (1, 2, 2)},
        {"episodes": 3},
        {"drivers": 1},
        {"scale_episodes": 0},
    ],
)
def test_bad_options_are_refused(wrong):
    with pytest.raises(UserError):
        Config(**wrong)


@pytest.mark.slow
def test_the_tables_of_three_dials(tmp_path):
    """Three dials instead of the trained ones, and few episodes: every table has its rows."""
    for seed, path in ((1, DIAL), (2, OTHER_DIAL), (3, OTHER_DIAL)):
        folder = tmp_path / folder_of("dials", str(seed))
        folder.mkdir(parents=True)
        DialPolicy.load(path).save(folder / "dial.safetensors")
    config = Config((1, 2, 3), 1, 50_820_000, 4, 1, 3, 2, spreads=(0.0,))
    jobs = [job for job in plan(config) if job.stage not in ("demonstrations", "dials")]
    for job in jobs:
        (tmp_path / job.name).mkdir(parents=True)
        inputs = {name: tmp_path / name for name in job.inputs}
        job.work(job.config, tmp_path / job.name, inputs, lambda _share: None)
    findings = zeros.compute_tables(config, Context(jobs, tmp_path, silent))
    found = findings.tables
    assert len(found["realised"]) == 5 * 13
    assert len(found["zeros"]) == (3 * 3 + 4) * 7
    assert [row["driver"] for row in found["populations"]] == ["1", "2", "3", PLAIN]
    assert len(found["drivers"]) == 12
    for row in found["drivers"]:
        assert row["low"] <= row["narrow_low"] <= row["narrow_high"] <= row["high"]
    assert len(findings.summary) == 2
    results = Results.of("angle-zeros", config, found, findings.summary, findings.files)
    assert zeros.draw(results).keys() == {"zeros"}
    assert len(zeros.view(results)) == 2
