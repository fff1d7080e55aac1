"""Sweep files: the combinations that they name, and refusals that name file and key."""

import dataclasses

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.learners import cql
from socialiq.learners.iq_learn.config import GRID, POC
from socialiq_lab.jobs import fingerprints
from socialiq_lab.sweep.plan import read_plan

FULL = """
preset = "poc"
worlds = ["crossing5", "offline"]
data = { crossing5 = ["a.bin", "b.bin"], offline = "a.bin" }
seeds = [3, 4]
runs_per_job = 3

[static]
updates = [10, 20]
hidden = [8]
value_term = "value_expert"

[static.endings]
timeout = ["zero", "bootstrap"]

[hyperparameters]
angle = [0, 45.5]
strength = 2
"""


@pytest.fixture(name="read")
def reader_of_a_file(tmp_path):
    def read(text):
        for name in "ab":
            (tmp_path / f"{name}.bin").write_bytes(name.encode())
        (tmp_path / "sweep.toml").write_text(text)
        return read_plan(tmp_path / "sweep.toml")

    return read


def test_every_combination_is_planned_once(read):
    plan = read(FULL)
    configs = [job.config for job in plan.jobs]
    assert [len(one.hyperparameters) for one in configs] == [3, 1] * 12
    runs = [(c.world, c.name, c.static, h) for c in configs for h in c.hyperparameters]
    assert len(runs) == len({*runs}) == 48  # 3 places, 2 updates, 2 endings, 2 angles, 2 seeds
    assert {(c.world, c.name) for c in configs} == {
        ("crossing5", "a.bin"),
        ("crossing5", "b.bin"),
        ("", "a.bin"),
    }
    assert all(c.static.online == (c.world != "") for c in configs)
    assert {c.static.next_value for c in configs} == {POC.next_value}
    assert {c.static.hidden for c in configs} == {(8,)}
    assert [(h.angle, h.seed) for c in configs[:2] for h in c.hyperparameters] == [
        (0.0, 3),
        (0.0, 4),
        (45.5, 3),
        (45.5, 4),
    ]
    assert {h.strength for c in configs for h in c.hyperparameters} == {2.0}
    assert len({*fingerprints(plan.jobs).values()}) == 24


def test_options_of_an_environment_make_a_world_each(read):
    places = 'worlds = ["socialiq/Intersection-v1"]\ndata = "a.bin"\n'
    jobs = read(places + '[options]\nclock = true\nshift = ["none", "late"]').jobs
    chosen = [{"clock": True, "shift": shift} for shift in ("none", "late")]
    assert [job.config.options for job in jobs] == chosen
    assert len({*fingerprints(jobs).values()}) == 2


def test_defaults_are_one_run_of_the_grid_preset(read):
    (job,) = read('worlds = "crossing7"\ndata = "a.bin"').jobs
    assert job.config.static == GRID
    assert [one.seed for one in job.config.hyperparameters] == [0]


def test_another_content_of_a_data_set_is_another_job(read, tmp_path):
    text = 'worlds = "crossing5"\ndata = "a.bin"'
    before = fingerprints(read(text).jobs)
    (tmp_path / "a.bin").write_bytes(b"other")
    after = fingerprints(read_plan(tmp_path / "sweep.toml").jobs)
    assert before != after


def test_several_widths_are_a_list_of_lists(read):
    jobs = read('worlds="crossing5"\ndata="a.bin"\n[static]\nhidden = [[8], [8, 4]]').jobs
    assert [job.config.static.hidden for job in jobs] == [(8,), (8, 4)]


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ("lambda = 1", "lambda: unknown key: choose from learner, preset"),
        ('learner = "sql"', "learner: unknown learner 'sql': choose one of behaviour-cloning, cql"),
        ('learner = "mine.py:Mine"', "learner: learner .* runs its author's code with your rights"),
        ('learner = "cql"\npreset = "poc"', "preset: is of iq_learn: leave it out"),
        ('learner = "cql"\n[static]\nonline = false', "static.online: unknown key"),
        ('preset = "gird"', "preset: unknown: choose one of table-c1"),
        ("runs_per_job = 0", "runs_per_job: must be at least 1, got 0"),
        ('worlds = "crossing6"', "worlds: unknown world 'crossing6': choose crossing5"),
        ("worlds = []", "worlds: must name at least one world"),
        ("data = 3", "data: must be text in quotes, got 3"),
        ('data = "c.bin"', "data: no such file: .*c.bin"),
        ('data = { crossing7 = "a.bin" }', "data.crossing7: unknown key: choose from crossing5"),
        ("seeds = [1, 1]", "seeds: must be one or more different whole numbers"),
        ("seeds = [-1]", "seeds: seed must lie in"),
        ("seeds = 0.5", "seeds: must be a whole number, got 0.5"),
        ("static = 3", "static: must be a table"),
        ("[options]\nclock = true", "options: are of a Gymnasium id: leave crossing5 out"),
        ('worlds = "a/B-v0"\n[options]\nx = []', "options.x: must have at least one value"),
        ('worlds = "a/B-v0"\n[options]\nx = 2020-01-01', "options.x: must be text, a number"),
        ('worlds = "a/B-v0"\n[options]\nx = nan', "options.x: must be text, a number"),
        ("[static]\nonline = true", "static.online: unknown key"),
        ("[static]\nhidden = 8", "static.hidden: must be a list of whole numbers, got 8"),
        (
            '[static]\nprior = ["none", "l3"]',
            "static.prior: unknown value 'l3': choose",
        ),
        ("[static]\nupdates = []", "static.updates: must have at least one value"),
        ("[static]\nupdates = 0", "static.updates: updates must be"),
        ("[static]\nshift_term_3 = 1", "static.shift_term_3: must be true or false, got 1"),
        ('[static.endings]\ncrash = "zero"', "static.endings.crash: unknown key"),
        (
            '[static.endings]\ntimeout = "cut"',
            "static.endings.timeout: unknown value 'cut': choo",
        ),
        (
            '[static]\nprior = "shifted_chi2"\ndivergence = "kl"',
            "static: --prior shifted_chi2 needs --divergence chi2",
        ),
        ("[hyperparameters]\nseed = 1", "hyperparameters.seed: unknown key"),
        ("[hyperparameters]\nangle = [0, true]", "hyperparameters.angle: must be a number, got T"),
        ("[hyperparameters]\ntemperature = -1", "hyperparameters.temperature: temperature must"),
    ],
)
def test_a_mistake_is_refused_in_one_line_that_names_file_and_key(read, tmp_path, change, line):
    key = change.partition(" ")[0]
    base = {"worlds": 'worlds = "crossing5"', "data": 'data = "a.bin"'}
    base.pop(key, None)
    with pytest.raises(UserError, match=f"^{tmp_path}/sweep.toml: {line}") as caught:
        read("\n".join([*base.values(), change]))
    assert "\n" not in str(caught.value)


def test_what_is_no_toml_is_refused(read, tmp_path):
    with pytest.raises(UserError, match=r"sweep\.toml is not TOML: "):
        read("worlds = [")
    with pytest.raises(UserError, match=r"^no such file: .*gone\.toml"):
        read_plan(tmp_path / "gone.toml")
    with pytest.raises(UserError, match="data: is missing: name at least one file"):
        read("seeds = 1")


def test_another_learner_has_its_own_settings_and_learns_from_data_alone(read):
    text = 'learner = "cql"\nworlds = ["crossing5", "offline"]\ndata = "a.bin"\n'
    plan = read(text + "[hyperparameters]\nconservatism = [1, 2]")
    found = [(c.world, one.conservatism) for c in configs(plan) for one in c.hyperparameters]
    assert found == [("crossing5", 1.0), ("crossing5", 2.0), ("", 1.0), ("", 2.0)]
    assert all(c.static == cql.CQLConfig() and c.learner == "cql" for c in configs(plan))
    with pytest.raises(UserError, match="worlds: this learner trains offline: leave 'm:A-v0' out"):
        read(text.replace('"offline"', '"m:A-v0"'))


def configs(plan):
    return [job.config for job in plan.jobs]


def test_too_many_runs_are_refused_before_they_are_made(read):
    angles = ", ".join(map(str, np.linspace(0, 90, 400)))
    weights = ", ".join(map(str, np.linspace(1, 2, 400)))
    text = f'worlds="crossing5"\ndata="a.bin"\n[hyperparameters]\nangle=[{angles}]\n'
    with pytest.raises(UserError, match="more than 100,000 runs: split it"):
        read(f"{text}strength=[{weights}]")


def test_a_job_is_of_json_able_fields(read):
    config = read(FULL).jobs[0].config
    assert dataclasses.asdict(config)["static"]["endings"]["timeout"] == "zero"
