"""Declared studies: settings, trainings, tables and figures of a STUDY.toml, without a training."""

import dataclasses
import pathlib
import pickle
import tomllib
from types import SimpleNamespace

import pytest

from socialiq.errors import UserError
from socialiq.learners.dial.config import INTERSECTION
from socialiq.plotting.figures import draw
from socialiq.results_folder import Results
from socialiq.settings import assignments, changed
from socialiq_lab import registry
from socialiq_lab.declared import KEYS, KINDS, declared_study
from socialiq_lab.declared_settings import config_class, resolved, variants
from socialiq_lab.jobs import fingerprints
from socialiq_lab.study import Context, Findings, silent
from socialiq_lab.tables import derived, paired_table, where

DECLARATION = """
title = "A study"
world = "crossing5"

[config]
seeds = [0, 1]
strengths = [0.5, 2.0]
kinds = ["running", "to_go"]
comparisons = true

[defaults]
rows = "policies"
static = { updates = 5 }

[[train]]
stage = "baseline, {kinds.0}"
data = { trajectories = 2 }

[[train]]
each = { kind = "$kinds" }
stage = "{kind}"
static = { target_kind = "$kind" }
runs = { strength = "$strengths" }

[[train]]
if = "$comparisons"
stage = "clones"
"""


@pytest.fixture(name="content")
def parsed_declaration():
    return tomllib.loads(DECLARATION)


@pytest.fixture(name="config")
def default_config(content):
    return config_class("a-study", content)()


def test_settings_have_the_types_of_their_defaults(config):
    types = {field.name: field.type for field in dataclasses.fields(config)}
    assert types["seeds"] == tuple[int, ...] and types["strengths"] == tuple[float, ...]
    new = changed(config, assignments(["strengths=1,3", "comparisons=false", "kinds=['a, b']"]))
    assert new.strengths == (1.0, 3.0) and new.comparisons is False and new.kinds == ("a, b",)


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["updates=3"], "there is no setting updates: choose one of seeds, strengths, kinds"),
        (["seeds"], "--set takes KEY=VALUE"),
        (["seeds=1,x"], "seeds must be an integer, got 'x'"),
        (["comparisons=2"], "choose one of true, false"),
        (["seeds.0=2"], "seeds has no settings of its own"),
    ],
)
def test_wrong_settings_are_refused_with_the_valid_ones(config, words, line):
    with pytest.raises(UserError, match=line):
        changed(config, assignments(words))


@pytest.mark.parametrize("value", ["[]", "[1, 'a']", "{ a = 1 }", "1979-05-27"])
def test_settings_without_a_plain_type_are_refused(value):
    with pytest.raises(UserError, match="must be a"):
        config_class("a-study", tomllib.loads(f"[config]\nsetting = {value}"))


def test_a_setting_may_list_the_names_of_declared_tables():
    content = tomllib.loads('config.methods = "$method"\n[method.b]\n[method."a, longer"]')
    assert config_class("a-study", content)().methods == ("b", "a, longer")
    with pytest.raises(UserError, match="methods must be a list of equal types, and not empty"):
        config_class("a-study", {"config": {"methods": "$method"}})


def test_a_setting_may_be_a_dataclass_of_this_project_with_other_values():
    content = tomllib.loads(
        """
counts = ["updates"]
[config]
dial = { of = "socialiq.learners.dial.config:DialConfig", hidden = [8] }
learner = { of = "socialiq.learners.iq_learn.config:IQLearnConfig", endings.timeout = "bootstrap" }
preset = { of = "socialiq.learners.dial.config:INTERSECTION.numbers", seed = 3 }
rule = { of = "socialiq_lab.intersection.driving:Shipped", file = "a" }
updates = 5
"""
    )
    config = config_class("a-study", content)()
    assert config.dial.hidden == (8,) and config.learner.endings.timeout == "bootstrap"
    assert config.preset == dataclasses.replace(INTERSECTION.numbers, seed=3)
    assert config.rule.file == "a"
    assert changed(config, {"dial": {"hidden": [4]}}).dial.hidden == (4,)
    with pytest.raises(UserError, match="updates must be at least 1, got 0"):
        changed(config, {"updates": 0})


def test_settings_that_do_not_fit_together_are_refused_by_the_study():
    def check(config):
        raise UserError(f"{config.updates} are too few")

    with pytest.raises(UserError, match="5 are too few"):
        config_class("a-study", {"config": {"updates": 5}}, check)()


@pytest.mark.parametrize(
    "name",
    ["os:system", "socialiq.nowhere:Config", "socialiq.errors:one_of", "socialiq.errors:two_of"],
)
def test_a_setting_of_anything_else_is_refused(name):
    with pytest.raises(UserError, match="value must be a dataclass of socialiq"):
        config_class("a-study", {"config": {"value": {"of": name}}})


def test_a_declaration_without_settings_is_refused():
    with pytest.raises(UserError, match="has no table config"):
        declared_study("a-study", {"title": "A study"})


def test_each_train_is_multiplied_out_over_the_defaults(content, config):
    trainings = variants(content, config)
    assert [training["stage"] for training in trainings] == [
        "baseline, running",
        "running",
        "to_go",
        "clones",
    ]
    assert trainings[1]["static"] == {"updates": 5, "target_kind": "running"}
    assert trainings[2]["runs"] == [{"strength": 0.5}, {"strength": 2.0}]
    fewer = variants(content, dataclasses.replace(config, comparisons=False))
    assert [training["stage"] for training in fewer] == [t["stage"] for t in trainings[:-1]]


def test_a_reference_to_no_setting_is_refused(config):
    assert resolved(["$seeds.1", {"a": "$comparisons"}, 2], config) == [1, {"a": True}, 2]
    with pytest.raises(UserError, match="updates is no setting"):
        resolved("$updates", config)


def test_runs_are_multiplied_out_the_last_axis_varying_fastest_and_reciprocals_added():
    train = {"runs": {"angle": "modes", "strength": [1.0, 4.0]}, "targets": "modes"}
    train |= {"reciprocal": {"reweight_temperature": "strength"}}
    (training,) = variants({"train": [train]}, config_class("a", {"config": {"seeds": [0]}})())
    assert training["targets"] == [0.0, 45.0, 90.0]
    assert [(run["angle"], run["strength"]) for run in training["runs"][:3]] == [
        (0.0, 1.0),
        (0.0, 4.0),
        (45.0, 1.0),
    ]
    assert [run["reweight_temperature"] for run in training["runs"][:2]] == [1.0, 0.25]
    assert len(training["runs"]) == 6


TRAIN = {"rows": "policies", "stage": "training", "label": {}, "preset": "grid"}
TRAIN |= {"data": {"trajectories": 2}}
PAIRED = {"name": "a", "from": "policies"}
BY = {"by": "readout", "reference": "greedy", "columns": ["regret"]}
FIGURE = {"name": "a", "table": "policies", "x": "angle", "y": "regret"}


def test_what_fits_is_a_job_for_each_training_of_a_fingerprint_of_its_own(content):
    content["defaults"] |= {"label": {}, "preset": "grid"}
    for train in content["train"]:
        train["data"] = {"trajectories": 2}
    content["train"][2]["learner"] = "behaviour_cloning"
    study = declared_study("a-study", content)
    jobs = study.jobs(study.Config())
    names = [job.name for job in jobs]
    assert names == ["baseline, running/0", "running/1", "to_go/2", "clones/3"]
    known = fingerprints(jobs)
    assert len({*known.values()}) == 4
    other = fingerprints(study.jobs(study.Config(strengths=(0.5, 3.0))))
    assert [name for name in names if other[name] != known[name]] == ["running/1", "to_go/2"]


@pytest.mark.parametrize("stage", ["..", "../../out", "a/b", "C:\\a"])
def test_the_text_of_a_stage_names_no_other_folder(stage):
    content = {"world": "crossing5", "config": {"seeds": [0]}, "train": [TRAIN | {"stage": stage}]}
    study = declared_study("a-study", content)
    (job,) = study.jobs(study.Config())
    parts = pathlib.PurePosixPath(job.name).parts
    assert len(parts) == 2 and parts[0].strip(" ") in ("", "out", "a b", "C  a")


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"train": [TRAIN | {"seed": 3}]}, "unknown key of train in STUDY.toml 'seed': choose"),
        ({"train": [{"rows": "policies"}]}, "give each train stage and label and data"),
        ({"train": [TRAIN | {"learner": "sac"}]}, "unknown learner 'sac': choose one of iq_learn"),
        ({"train": [TRAIN | {"preset": "7x7"}]}, "unknown preset '7x7': choose one of"),
        (
            {"train": [TRAIN | {"data": {"rows": 2}}]},
            "unknown kind of data 'rows': choose one of t",
        ),
        ({"train": [TRAIN | {"prior": "l1"}]}, "study.py beside it has no function l1"),
        (
            {"train": [TRAIN | {"runs": {"angel": [0.0]}}]},
            "there is no setting angel: choose one of",
        ),
        (
            {"table": [{"name": "a", "from": "runs"}]},
            "unknown table 'runs': choose one of policies",
        ),
        ({"table": [{"name": "a", "from": "a"}]}, "unknown table 'a': choose one of policies"),
        (
            {"train": [TRAIN | {"runs": {"angle": 0.0}}]},
            "angle must be a list, or .modes., got 0.0",
        ),
        ({"train": [TRAIN | {"reciprocal": {"temperature": "strength"}}]}, "number of the runs"),
        ({"table": [{"from": "policies"}]}, "give each table name"),
        ({"table": [{"python": "rows"}]}, "give each table name"),
        ({"table": [{"name": "a", "python": "rows"}]}, "beside it has no function rows"),
        ({"summary": {"from": "policies"}}, "give each summary nest"),
        (
            {"figure": [FIGURE | {"kind": "pie"}]},
            "unknown kind of figure 'pie': choose one of lines",
        ),
        ({"figure": [FIGURE | {"layers": [{"kind": "pie"}]}]}, "unknown kind of figure 'pie'"),
        ({"figure": [FIGURE | {"colour": "red"}]}, "unknown key of figure in STUDY.toml 'colour'"),
        ({"figure": [FIGURE | {"rows": "angles"}]}, "beside it has no function angles"),
        ({"figure": [{"name": "a", "table": "policies"}]}, "give each figure x and y"),
        ({"view": [{"columns": ["angle"]}]}, "give each view table"),
        ({"view": [{"table": "$rows"}]}, "rows is no setting of the table config"),
        ({"view": [{"table": "policy"}]}, "unknown table 'policy': choose one of policies"),
        (
            {"view": [{"table": "policies", "columns": ["angle", "regrett"]}]},
            "unknown column 'regrett': choose one of readout, seed, target_angle, regret, r_env",
        ),
        (
            {"view": [{"table": "policies", "pivot": ["seed", "readout", "regrett"]}]},
            "unknown column 'regrett': choose one of",
        ),
        ({"view": [{"table": "policies", "where": {"sed": 0}}]}, "unknown column 'sed': choose"),
        (
            {"table": [{"name": "a", "from": "policies", "pool": ["sed"]}]},
            "unknown column 'sed': choose one of readout, seed",
        ),
        ({"table": [{"name": "a", "from": "policies", "mean": ["sed"]}]}, "unknown column 'sed'"),
        ({"table": [PAIRED | {"paired": BY | {"by": "sed"}}]}, "unknown column 'sed'"),
        (
            {"table": [PAIRED | {"paired": BY | {"reference": "gready"}}]},
            "unknown readout 'gready': choose one of greedy, soft",
        ),
        ({"summary": {"from": "policies", "nest": ["sed"]}}, "unknown column 'sed': choose"),
        (
            {"summary": {"from": "policies", "nest": ["%(sed)s"]}},
            "unknown column 'sed': choose one of",
        ),
        (
            {"summary": {"from": "policies", "nest": ["seed"], "keep": ["regrett"]}},
            "unknown column 'regrett': choose one of",
        ),
        ({"figure": [FIGURE | {"x": "angel"}]}, "unknown column 'angel': choose one of"),
        ({"figure": [FIGURE | {"y": ["regret", "regrett"]}]}, "unknown column 'regrett': choose"),
        ({"figure": [FIGURE | {"lines": "sed"}]}, "unknown column 'sed': choose one of"),
        ({"figure": [FIGURE | {"panels": "sed"}]}, "unknown column 'sed': choose one of"),
        ({"figure": [FIGURE | {"table": "policy"}]}, "unknown table 'policy': choose one of"),
        ({"figure": [FIGURE | {"xscale": "logg"}]}, "STUDY.toml raised ValueError: 'logg' is not"),
        (
            {"train": [TRAIN | {"label": {"at": "@angel"}}]},
            "unknown number of the runs 'angel': choose one of",
        ),
        (
            {"train": [TRAIN | {"static": {"update": 3}}]},
            "there is no setting update: choose one of",
        ),
        ({"tabel": [{}]}, "unknown key of STUDY.toml 'tabel': choose one of title, "),
    ],
)
def test_what_the_grammar_lacks_is_refused_before_anything_is_trained(changes, line):
    content = {"world": "crossing5", "config": {"seeds": [0]}, "train": [TRAIN]} | changes
    study = declared_study("a-study", content)
    with pytest.raises(UserError, match=line):
        study.jobs(study.Config())


def test_a_declaration_without_a_world_and_a_condition_without_a_column_are_refused():
    study = declared_study("a-study", {"config": {"seeds": [0]}, "train": [TRAIN]})
    with pytest.raises(UserError, match="name its world, or compute its tables"):
        study.jobs(study.Config())
    with pytest.raises(UserError, match="unknown column 'methods': choose one of method, str"):
        where(ROWS, {"methods": "ours"})
    assert where([], {"methods": "ours"}) == []


def test_a_study_that_computes_its_tables_derives_others_from_them():
    class Module:
        @staticmethod
        def compute_tables(config, context):
            return Findings({"rows": ROWS}, {"of": "python"})

        @staticmethod
        def best(state):
            return [max(state.tables["means"], key=lambda row: row["score"])]

    table = {"name": "means", "from": "rows", "where": {"strength": 2.0}, "mean": ["method"]}
    content = {"config": {"seeds": [0]}, "table": [table, {"name": "best", "python": "best"}]}
    study = declared_study("a-study", content, Module)
    context = Context((), pathlib.Path(), silent)
    results = study.tables(study.Config(), context)
    assert [row["method"] for row in results.tables["means"]] == ["ours", "theirs"]
    assert results.tables["best"] == [
        {"method": "ours", "strength": 2.0, "seed": 1.0, "score": pytest.approx(3.1)}
    ]
    assert results.summary == {"of": "python"}
    content["summary"] = {"from": "means", "nest": ["method"], "keep": ["score"]}
    summary = declared_study("a-study", content, Module).tables(study.Config(), context).summary
    assert summary == {
        "of": "python",
        "ours": {"score": pytest.approx(3.1)},
        "theirs": {"score": pytest.approx(2.1)},
    }


def test_the_page_explains_every_key_of_the_grammar():
    page = pathlib.Path(__file__).parents[3] / "docs" / "add-a-study.md"
    rows = [line for line in page.read_text().splitlines() if line.startswith("| `[")]
    for table, keys in KEYS.items():
        (row,) = [line for line in rows if line.startswith((f"| `[[{table}]]", f"| `[{table}]"))]
        if table != "figure":  # its labels, scales and limits are named together
            assert not [key for key in " ".join(keys).split() if f"`{key}" not in row], table


ROWS = [
    {"method": method, "strength": strength, "seed": seed, "score": base + strength + 0.1 * seed}
    for method, base in (("ours", 1.0), ("theirs", 0.0))
    for strength in (1.0, 2.0)
    for seed in (0, 1, 2)
]


def test_rows_are_selected_and_averaged():
    assert len(where(ROWS, {"method": "ours", "strength": [1.0, 2.0]})) == 6
    means = derived({"from": "rows", "mean": ["method", "strength"]}, {"rows": ROWS}, None)
    assert means[0]["method"] == "ours" and means[0]["score"] == pytest.approx(2.1)


def test_groups_are_compared_with_a_reference_by_seed():
    tests = paired_table(ROWS, "method", "theirs", ["score"], within=["strength"])
    assert [(row["strength"], row["method"], row["metric"]) for row in tests] == [
        (1.0, "ours", "score"),
        (2.0, "ours", "score"),
    ]
    assert all(abs(row["mean"]) == pytest.approx(1.0) for row in tests)
    assert all(row["p_holm"] >= row["p"] for row in tests)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "heatmap"])
def test_a_figure_has_a_panel_for_each_value_and_a_line_for_each_group(kind):
    results = Results("a-study", {}, {"rows": ROWS}, {}, {})
    specification = {"table": "rows", "x": "seed", "y": "score", "kind": kind}
    specification |= {"panels": "strength", "lines": "method"}
    picture = draw(specification, results)
    assert picture is not None and len(picture.axes) == 2
    assert picture.axes[0].get_title() == "strength 1"
    _, labels = picture.axes[0].get_legend_handles_labels()
    assert labels == ["ours", "theirs"]


def test_a_heat_map_has_a_colour_for_each_pair():
    results = Results("a-study", {}, {"rows": ROWS}, {}, {})
    specification = {"table": "rows", "x": "seed", "by": "strength", "y": "score"}
    picture = draw(specification | {"kind": "heatmap", "where": {"method": "ours"}}, results)
    assert picture is not None
    assert picture.axes[0].images[0].get_array().shape == (2, 3)


def test_parts_of_a_name_become_columns_and_a_figure_without_rows_is_left_out():
    rows = [
        {"policy": f"learners/{angle}/{seed}", "r": 1.0} for angle in (0, 45) for seed in (1, 2)
    ]
    results = Results("a-study", {}, {"rows": [*rows, {"policy": "drivers/go", "r": 0.0}]}, {}, {})
    specification = {"table": "rows", "x": "angle", "y": "r", "kind": "band"}
    specification |= {"split": {"policy": "stage/angle/seed"}}
    picture = draw(specification | {"where": {"stage": "learners"}}, results)
    assert picture is not None
    assert picture.axes[0].lines[0].get_xdata().tolist() == [0.0, 45.0]
    assert draw(specification | {"where": {"stage": "experts"}}, results) is None


def test_every_study_has_a_title_a_tiny_preset_that_fits_and_references_that_resolve():
    for name in registry.STUDIES:
        study, content = registry.study_and_declaration(name)
        assert study.name == name
        assert len(content["title"]) <= 80 and not content["title"].endswith(".")
        changed(study.Config(), content.get("tiny", {}))
        settings = SimpleNamespace(**dataclasses.asdict(study.Config()))
        for table in ("table", "figure", "view"):
            assert all(resolved(entry, settings) for entry in content.get(table, ()))


def test_a_study_that_has_retired_names_its_page():
    with pytest.raises(UserError, match="has retired: docs/studies/history"):
        registry.find("roads")


def test_settings_go_to_another_process_by_their_values():
    config = registry.find("theory").Config()
    received = pickle.loads(pickle.dumps(config))
    assert dataclasses.asdict(received) == dataclasses.asdict(config)
    again = pickle.loads(pickle.dumps(received))
    assert dataclasses.asdict(again) == dataclasses.asdict(config)
