"""The committed comparison of methods: its tables again from its rows, and one method again."""

import pytest

from socialiq import results_folder as store
from socialiq.results_folder import from_csv
from socialiq.storage import packaged_results
from socialiq_lab.comparison import FRESH, cells_of
from socialiq_lab.comparison_jobs import ROWS, GridRuns
from socialiq_lab.registry import find
from socialiq_lab.tables import matching, pooled
from studies.compare_methods.intersection import METHODS
from studies.compare_methods.study import (
    KEYS,
    choose,
    overall,
    paired,
    run_method,
    updates_of,
)

FULL_COMPILER = True
Config = find("compare-methods").Config


FOLDERS = "compare-methods", "compare-methods-intersection", "compare-methods-large"


@pytest.fixture(name="committed", scope="module", params=FOLDERS)
def results(request):
    return store.load(packaged_results() / request.param)


def close(ours, theirs) -> None:
    """Rows of a CSV file have six decimals, so that what follows from them may differ in the last.

    P-values of differences that are 0 but for that have no meaning.
    """
    assert len(ours) == len(theirs)
    for one, other in zip(ours, theirs, strict=True):
        tied = abs(other.get("difference", 1.0)) < 1e-4
        for name, value in other.items():
            if isinstance(value, float) and not (tied and name in ("p", "p_holm", "low", "high")):
                assert one[name] == pytest.approx(value, rel=1e-3, abs=1e-4), (other, name)
            elif not isinstance(value, float):
                assert one[name] == value or name in ("p", "p_holm"), (other, name)


def test_the_tables_follow_from_the_rows(committed):
    found = committed.tables
    means = pooled(found["policies"], KEYS, ("value", "regret"), ())
    close(means, found["pooled"])
    close(overall(means, found["overall"]), found["overall"])
    close(paired(found["policies"]), found["paired"])


def test_the_settings_are_those_that_development_chose(committed):
    chosen = choose(committed.tables["development"])
    for row in committed.tables["overall"]:
        assert chosen[row["world"], row["method"]] == row["setting"]


def test_every_method_has_every_seed_and_angle(committed):
    config = Config(**{name: tuple(committed.config[name]) for name in ("worlds", "methods")})
    for world, method in cells_of(config, METHODS):
        rows = matching(committed.tables["policies"], world=world, method=method.name)
        greedy = [(row["seed"], row["target_angle"]) for row in rows if row["readout"] == "greedy"]
        assert len(set(greedy)) == len(greedy) == len(config.seeds) * len(config.angles)


def test_one_method_trained_again_is_equal(tmp_path):
    """Clones of the episodes that score best, in the 5x5 world: the ends, on one of the seeds."""
    method, config = METHODS["clone_by_return"], Config(angles=(0.0, 90.0), seeds=(300,))
    rows = store.load(packaged_results() / FOLDERS[0]).tables["policies"]
    theirs = matching(rows, world="crossing5", method=method.name)
    settings = (method.setting_of(theirs[0]["setting"]),)
    updates = updates_of(method, config.updates)
    run = GridRuns.of(config, FRESH, "crossing5", method, settings, updates)
    run_method(run, tmp_path, {}, lambda _: None)
    keys = ("target_angle", "readout", "seed")
    wanted = {tuple(row[key] for key in keys): row for row in theirs}
    greedy = matching(from_csv(tmp_path / ROWS), readout="greedy")
    assert len(greedy) == 2
    for row in greedy:
        again = wanted[tuple(row[key] for key in keys)]
        assert row["regret"] == pytest.approx(again["regret"], abs=1e-5)
        assert row["angle"] == pytest.approx(again["angle"], abs=1e-3)
