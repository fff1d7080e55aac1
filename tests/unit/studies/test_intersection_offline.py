"""Offline learning in the intersection end to end at a tiny size: jobs, tables, figures."""

import dataclasses

import numpy as np
import pytest
from tests.digest.studies import differs

from socialiq import results_folder as store
from socialiq.errors import UserError
from socialiq.learners.dial.config import OfflineDialConfig
from socialiq.nn.dial_policy import DialPolicy
from socialiq.plotting.style import png
from socialiq_lab.registry import find
from studies.intersection_offline.study import (
    DEMONSTRATOR,
    METHODS,
    OWN,
    jobs,
    program_of,
    runs_of,
    verdict,
)

STUDY = find("intersection-offline")
Config = STUDY.Config

DRIVEN = (
    "clone weighted by R(α)",
    "clone weighted by advantage",
    "clone of the mode",
    "clone of all",
    "IQ-Learn, dueling, reweighted",
    "IQ-Learn online, shifted χ²",
)
"""Methods that are run: each kind of training once."""

TINY = Config(
    seeds=(0, 1),
    angles=(0.0, 45.0, 90.0),
    methods=DRIVEN,
    method_angles=(0.0, 90.0),
    structure=OfflineDialConfig(view="flat", hidden=(8,), updates=20, batch_size=8),
    updates=20,
    together=2,
    pool_episodes=12,
    size=60,
    episodes=12,
)


def test_every_method_has_settings_of_its_own():
    made = [runs_of(TINY, method, (0,)) for method in METHODS]
    assert all(made[i] != made[j] for i in range(len(made)) for j in range(i))
    online = [method for method in METHODS if "online" in method]
    assert len(online) == 3
    for method, runs in zip(METHODS, made, strict=True):
        assert getattr(runs.structure, "online", False) == (method in online)


def test_no_table_of_the_digest_differs(results, work):
    assert differs("intersection-offline", results, work) == []


def test_every_policy_is_valued_at_its_angles(results):
    rows = results.tables["policies"]
    by_method = {method: [r for r in rows if r["method"] == method] for method in (OWN, *DRIVEN)}
    assert len(by_method[OWN]) == 2 * 3
    assert all(len(by_method[method]) == 2 * 2 for method in DRIVEN)
    assert sum(row["method"].startswith(DEMONSTRATOR) for row in rows) == 3 * 3
    for row in rows:
        radians = np.deg2rad(row["asked"])
        value = np.cos(radians) * row["r_env"] + np.sin(radians) * row["r_social"]
        assert row["value"] == pytest.approx(value, abs=1e-5)
        assert row["episodes"] == TINY.episodes


def test_a_clone_of_all_is_one_for_every_angle(work, results):
    files = sorted((work / "learners" / "clone-of-all" / "0").glob("*/*/*.safetensors"))
    assert [file.parts[-3:-1] for file in files] == [("0", "0"), ("1", "0")]
    mine = [row for row in results.tables["policies"] if row["method"] == "clone of all"]
    first, last = (row for row in mine if row["seed"] == 0)
    assert first["r_env"] == last["r_env"] and first["asked"] != last["asked"]


def test_the_dial_is_compared_with_the_best_demonstrator_and_with_every_method(results):
    rows = results.tables["differences"]
    assert len(rows) == 3 + 2 * len(DRIVEN)
    policies = results.tables["policies"]
    for row in rows:
        if row["other"].startswith(DEMONSTRATOR):
            here = [one for one in policies if one["asked"] == row["asked"]]
            best = max(o["value"] for o in here if o["method"].startswith(DEMONSTRATOR))
            mean = np.mean([one["value"] for one in here if one["method"] == OWN])
            assert row["mean"] == pytest.approx(mean - best, abs=1e-5)
    verdicts = results.summary["against_best_demonstrator"]
    assert set(verdicts) == {"0", "45", "90"}
    assert set(verdicts.values()) <= {"above", "level", "below"}


def test_the_dial_of_the_first_seed_is_kept_with_the_results(results, work):
    file = work / "dials" / "0" / "0" / "dial.safetensors"
    assert results.files == {"dial.safetensors": file.read_bytes()}
    assert DialPolicy.load(file).provenance["numbers"]["seed"] == 0


def test_iq_learn_is_compared_with_the_weighted_clones(results):
    rows = results.tables["forms"]
    assert len(rows) == 2 * 2 * 2
    policies = {(r["method"], r["asked"]): [] for r in results.tables["policies"]}
    for row in results.tables["policies"]:
        policies[row["method"], row["asked"]].append(row["value"])
    for row in rows:
        mine, theirs = (policies[row[name], row["asked"]] for name in ("form", "other"))
        assert row["mean"] == pytest.approx(np.mean(mine) - np.mean(theirs), abs=1e-5)


def test_a_loss_is_called_one_without_adjustment():
    def row(mean: float, p: float, p_holm: float) -> str:
        return verdict({"mean": mean, "p": p, "p_holm": p_holm})

    assert row(1.0, 0.001, 0.01) == "above" and row(-1.0, 0.04, 0.4) == "below"
    assert row(1.0, 0.04, 0.4) == "level" == row(-1.0, 0.06, 0.4)


def test_seeds_may_be_trained_apart():
    alone = dataclasses.replace(TINY, together=1)
    assert [program_of(TINY, seed) for seed in (0, 1)] == [(0, 1), (0, 1)]
    assert [program_of(alone, seed) for seed in (0, 1)] == [(0,), (1,)]
    names = [job.name for job in jobs(alone)]
    assert len(set(names)) == len(names) and "dials/1" in names


def test_results_are_saved_and_drawn_from_the_files(results, tmp_path):
    store.save(results, tmp_path / "out", {}, replace=False)
    read = store.load(tmp_path / "out")
    assert read.summary == results.summary
    assert list(png(STUDY.figures(read))) == ["values"]


def test_a_config_without_sense_is_refused():
    for change in ({"seeds": ()}, {"methods": ("magic",)}, {"method_angles": (10.0,)}):
        with pytest.raises(UserError):
            dataclasses.replace(TINY, **change)
