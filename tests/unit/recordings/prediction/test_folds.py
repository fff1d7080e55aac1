from collections.abc import Callable

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq_recordings.prediction.situations import Situations, grouped
from socialiq_recordings.prediction.study import folds, possible

Make = Callable[..., Situations]


def _traffic(situations: Make, chains: int = 4) -> Situations:
    count = 60 * chains
    chain = np.repeat(np.arange(chains), 60)
    return situations(
        count,
        vehicle=np.arange(count) // 6,
        chain=chain,
        recording=chain,
        site=chain // 2,
        time=np.tile(np.arange(60) % 6 + np.arange(60) // 6 * 2.0, chains) + 1e6 * chain,
    )


def test_no_vehicle_and_no_site_is_on_both_sides(situations: Make) -> None:
    seen = _traffic(situations)
    for holdout, column in (("vehicles", seen.vehicle), ("sites", seen.site)):
        made = folds(seen, holdout)  # type: ignore[arg-type]
        assert (sum(fold.test.astype(int) for fold in made) == 1).all()
        for fold in made:
            assert not set(column[fold.train]) & set(column[fold.test])
            assert not set(seen.chain[fold.train]) & set(seen.chain[fold.test])


def test_what_is_learned_from_ends_before_what_is_predicted_begins(situations: Make) -> None:
    seen = _traffic(situations)
    (fold,) = folds(seen, "moments")
    for recording in range(4):
        here = seen.recording == recording
        assert (seen.time[fold.train & here] + 1).max() <= seen.time[fold.test & here].min()


def test_recordings_that_overlap_are_cut_at_one_time(situations: Make) -> None:
    # Two windows of one recording, 20 s apart: what one shows later the other shows earlier.
    time = np.concatenate([np.arange(60.0), 20 + np.arange(60.0)])
    seen = situations(120, recording=np.repeat([0, 1], 60), time=time)
    (fold,) = folds(seen, "moments")
    assert seen.time[fold.train].max() + 1 <= seen.time[fold.test].min() == 40.0


def test_vehicles_of_one_chain_are_held_out_with_all_that_they_meet(situations: Make) -> None:
    count = 400
    vehicle = np.arange(count) // 8
    seen = situations(count, vehicle=vehicle, time=np.arange(count) % 8 + vehicle * 3.0)
    made = folds(seen, "vehicles")
    assert len(made) == 5
    for fold in made:
        assert not set(vehicle[fold.train]) & set(vehicle[fold.test])
        apart = np.abs(seen.time[fold.train][:, None] - seen.time[fold.test][None])
        assert apart.min() > 1.0


def test_too_little_is_refused_in_a_line_that_says_what_is_missing(situations: Make) -> None:
    one_site = _traffic(situations, 2)
    with pytest.raises(UserError, match="show one site: add another place"):
        folds(one_site, "sites")
    assert possible(one_site) == ("moments", "vehicles")
    with pytest.raises(UserError, match="leaves 5 moments to learn from"):
        folds(situations(10), "moments")
    with pytest.raises(UserError, match="share their vehicles, 1 in all"):
        folds(situations(10), "vehicles")


def test_parts_are_about_equally_large_and_groups_stay_whole() -> None:
    group = np.repeat([3, 1, 7, 9], [10, 4, 5, 1])
    part = grouped(group, 2)
    assert sorted(np.bincount(part)) == [10, 10]
    assert all(len(set(part[group == one])) == 1 for one in (1, 3, 7, 9))
