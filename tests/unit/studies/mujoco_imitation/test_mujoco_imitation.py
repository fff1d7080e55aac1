"""Plan, pieces that are taken over, and tables; nothing here needs MuJoCo."""

import dataclasses
import json

import pytest

from socialiq.errors import UserError
from socialiq_lab.registry import find
from socialiq_lab.study import Context
from studies.mujoco_imitation import study
from studies.mujoco_imitation import study as plan
from studies.mujoco_imitation.runs import METHODS, RECIPES, TASKS, VARIANTS, Imitation, settled

Config = find("mujoco-imitation").Config
CHOSEN = "temperature 0.1, discount 0.97, linear rate, 100,000 updates"
LONGER = "online, standardised, 300,000 updates"
WITHOUT_FORCES = "online, standardised, temperature 0.3, 300,000 updates, no contact forces"

KEY = ("task", "method", "trajectories", "seed")
SMALL = {"tasks": ("Hopper",), "trajectories": (1, 5), "seeds": (0, 1)}
N_HOPPER = sum(method.forces for method in METHODS.values())
"""Methods of a task without contact forces."""
EXPERT = {
    "recipe": {"seed": 7, "updates": 40},
    "checkpoints": [{"updates": 20, "mean_return": 90.0}, {"updates": 40, "mean_return": 80.0}],
    "returns": [100.0, 200.0, 300.0],
}


def run(method: str, seed: int, *returns: float, count: int = 5) -> dict:
    return {
        "task": "Hopper",
        "method": method,
        "trajectories": count,
        "seed": seed,
        "updates": 10,
        "demonstrated_return": 199.0,
        "returns": list(returns),
    }


@pytest.fixture
def folder(tmp_path):
    """Results with an expert, three runs and a run of the ablations."""
    place = tmp_path / "results" / "pieces"
    place.mkdir(parents=True)
    (place / "Hopper_expert.json").write_text(json.dumps(EXPERT))
    (place / "Hopper_expert.safetensors").write_bytes(b"weights")
    for one in (
        run("online", 0, 150.0, 190.0),
        run("online", 1, 200.0, 200.0),
        run("cloning", 0, 50.0, 70.0),
        run("cloning", 1, 80.0, 40.0),
        run("regression", 0, 20.0),
    ):
        (place / plan.name_of(*(one[key] for key in KEY))).write_text(json.dumps(one))
    return str(tmp_path / "results")


def test_the_whole_plan_has_every_cell_and_the_ablations():
    found = list(plan.cells(Config()))
    blind = [name for name, method in METHODS.items() if not method.forces]
    everywhere = len(TASKS) * (len(METHODS) - len(blind)) * 3
    # Hopper, HalfCheetah and Walker2d observe no contact forces that could be left out.
    assert {task for task, method, _ in found if method in blind} == {"Ant"}
    assert len(found) == len(set(found)) == everywhere + 3 * len(blind) + len(VARIANTS)
    assert len(list(plan.cells(Config(ablate=False)))) == len(found) - len(VARIANTS)


def test_each_job_stands_after_its_inputs():
    jobs = plan.plan(Config(**SMALL))
    names = [job.name for job in jobs]
    assert all(set(job.inputs) <= set(names[:place]) for place, job in enumerate(jobs))
    assert sum(job.stage == "runs" for job in jobs) == 2 * N_HOPPER + len(VARIANTS)
    assert sum(job.stage == "shown" for job in jobs) == 2


def test_what_is_there_is_not_planned_again(folder):
    jobs = plan.plan(Config(**SMALL, pieces=folder))
    assert all(job.stage != "expert" for job in jobs)
    shown = [job for job in jobs if job.stage == "shown"]
    assert {(job.config.pieces, job.inputs) for job in shown} == {(folder, ())}
    seeds = {
        (job.config.method, job.config.trajectories): job.config.seeds
        for job in jobs
        if job.stage == "runs"
    }
    assert ("online", 5) not in seeds and ("cloning", 5) not in seeds
    assert seeds["online", 1] == seeds["offline", 5] == (0, 1) and seeds["regression", 5] == (1,)
    only = Config(tasks=("Hopper",), trajectories=(5,), methods=("online",), seeds=(0, 1))
    left = plan.plan(Config(**{**vars(only), "ablate": False, "pieces": folder}))
    assert left == [] == plan.plan(Config(**SMALL, pieces=folder, new=False))


def test_an_expert_shows_episodes_only_if_it_is_the_planned_one(folder, tmp_path, monkeypatch):
    job = next(job for job in plan.plan(Config(**SMALL, pieces=folder)) if job.stage == "shown")
    read = []
    monkeypatch.setattr(plan.ActorPolicy, "load", read.append)
    monkeypatch.setattr(plan.runs, "played", lambda *_inputs: None)
    monkeypatch.setattr(plan.files, "save", lambda *_inputs: None)
    plan.show(job.config, tmp_path, {}, lambda _share: None)
    expert = tmp_path / "results" / "pieces" / "Hopper_expert.safetensors"
    assert read == [expert]
    expert.write_bytes(b"others")
    with pytest.raises(UserError, match="has changed since the study began"):
        plan.show(job.config, tmp_path, {}, lambda _share: None)


def test_tables_are_of_the_pieces_that_are_there(folder, tmp_path):
    config = Config(**SMALL, pieces=folder, new=False)
    found = study.compute_tables(config, Context((), tmp_path, lambda _stage: None))
    (expert,) = found.tables["experts"]
    assert (expert["mean_return"], expert["best_checkpoint"], expert["episodes"]) == (200, 20, 3)
    cells = {(row["method"], row["trajectories"]): row for row in found.tables["cells"]}
    assert len(cells) == 2 * N_HOPPER
    online = cells["online", 5]
    assert (online["runs"], online["mean_return"], online["least_run"]) == (2, 185.0, 170.0)
    assert online["share"] == pytest.approx(0.925) and online["published"] == ""
    assert cells["online", 1]["runs"] == 0 and cells["online", 1]["share"] == ""
    assert cells["online", 1]["published"] == TASKS["Hopper"].published
    (test,) = found.tables["differences"]
    assert (test["first"], test["mean"]) == ("online", pytest.approx(0.625))
    assert [row["method"] for row in found.tables["ablations"]] == ["online", "regression"]
    assert found.tables["ablation_differences"] == []  # one seed of the variant
    assert len(found.files) == 2 + 5
    assert found.files["pieces/Hopper-regression-5-0.json"].startswith(b"{")


def test_ablations_are_tested_against_no_change():
    shares = {"online": [0.5, 0.7, 0.6], "regression": [0.1, 0.2, 0.3], "temperature 0.1": [0.6]}
    label = {"task": "Hopper", "trajectories": 5}
    runs = [
        label | {"method": method, "seed": seed, "share": share}
        for method, found in shares.items()
        for seed, share in enumerate(found)
    ]
    (test,) = study.ablation_difference_rows(runs)
    assert (test["first"], test["second"]) == ("regression", "online")
    assert test["mean"] == pytest.approx(-0.4) and test["p_holm"] == test["p"]


def test_a_damaged_folder_is_named(folder, tmp_path):
    for broken in ({"task": "Hopper"}, []):
        (tmp_path / "results" / "pieces" / "Hopper-online-5-0.json").write_text(json.dumps(broken))
        with pytest.raises(UserError, match=r"Hopper-online-5-0\.json is damaged"):
            plan.committed(folder)
    (tmp_path / "results" / "pieces" / "Hopper_expert.safetensors").unlink()
    (tmp_path / "results" / "pieces" / "Hopper-online-5-0.json").unlink()
    with pytest.raises(UserError, match=r"Hopper_expert\.safetensors is missing"):
        plan.committed(folder)
    with pytest.raises(UserError, match="holds no pieces"):
        plan.committed(str(tmp_path / "nothing"))


def test_a_run_of_an_unknown_method_is_named(folder, tmp_path):
    newer = run("online, of a later version", 0, 1.0)
    name = plan.name_of(*(newer[key] for key in KEY))
    (tmp_path / "results" / "pieces" / name).write_text(json.dumps(newer))
    with pytest.raises(UserError, match="is of online, of a later version on Hopper, which is unk"):
        plan.committed(folder)


def test_updates_are_the_given_ones_the_tasks_or_the_methods():
    def updates(method: str, given: int) -> int:
        run = Imitation("Hopper", method, 1, (0,), given, 1, 0)
        return settled(run).static.updates

    assert updates("online", 0) == TASKS["Hopper"].online_updates
    assert updates("cloning", 0) == METHODS["cloning"].static.updates
    assert updates("online", 30) == updates("offline", 30) == 30
    assert (updates(CHOSEN, 0), updates(CHOSEN, 30)) == (100_000, 30)


def test_the_chosen_settings_are_those_of_their_name():
    chosen, base = METHODS[CHOSEN], METHODS["online"]
    assert (chosen.numbers.temperature, chosen.numbers.discount) == (0.1, 0.97)
    assert (chosen.static.schedule, chosen.updates) == ("linear", 100_000)
    assert chosen.static.hidden == base.static.hidden


def test_standardised_methods_are_the_only_ones_with_standardised_observations():
    for name, method in METHODS.items():
        assert method.standardised == (", standardised" in name)
    online = METHODS["online, standardised"]
    assert online.numbers == METHODS["online"].numbers and online.updates == 100_000
    longer = METHODS[LONGER]
    assert longer.numbers == online.numbers and longer.updates == 300_000
    changed = dataclasses.replace(online.static, replay_capacity=300_000)
    assert longer.static == changed


def test_contact_forces_are_left_out_alone_beside_what_the_name_says():
    chosen = METHODS[WITHOUT_FORCES]
    numbers = dataclasses.replace(METHODS[LONGER].numbers, temperature=0.3)
    blind = {"clone": "cloning, standardised, no contact forces", "forces": False}
    assert chosen == dataclasses.replace(METHODS[LONGER], numbers=numbers, **blind)
    for kind in ("offline", "cloning"):
        base = METHODS[f"{kind}, standardised"]
        blind = METHODS[f"{kind}, standardised, no contact forces"]
        assert blind == dataclasses.replace(base, clone=blind.clone, forces=False)


def test_a_variant_changes_what_it_names_alone():
    base, changed = METHODS["online"], RECIPES["temperature 0.1"]
    assert changed.static == base.static and changed.numbers.temperature == 0.1
    assert RECIPES["absorbing states"].absorbing and not base.absorbing


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"tasks": ("Humanoid",)}, "Humanoid"),
        ({"methods": ("gail",)}, "gail"),
        ({"trajectories": (26,)}, "trajectories must be 1 to 25, got 26"),
        ({"judged": 0}, "judged must be at least 1"),
    ],
)
def test_bad_settings_are_refused(change, line):
    with pytest.raises(UserError, match=line):
        plan.jobs(Config(**change))
