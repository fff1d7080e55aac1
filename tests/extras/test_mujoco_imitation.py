"""Study `mujoco-imitation` at a tiny size: from an expert to tables, and once more from pieces."""

import pytest

from socialiq.nn.actor_policy import ActorPolicy
from socialiq.storage import packaged_results, read_json
from socialiq_lab.registry import find
from socialiq_lab.study import Context, run, save
from studies.mujoco_imitation import study as plan
from studies.mujoco_imitation.runs import METHODS, TASKS, returns
from studies.mujoco_imitation.study import compute_tables

pytest.importorskip("mujoco")

STUDY = find("mujoco-imitation")
Config = STUDY.Config

TINY = {
    "tasks": ("Hopper",),
    "trajectories": (5,),
    "seeds": (100,),
    "variants": ("absorbing states", "regression"),
    "expert_updates": 40,
    "updates": 30,
    "every": 20,
    "judged": 1,
    "episodes": 1,
    "expert_episodes": 2,
    "data_seed": 50_000_000,
    "judging_seed": 50_100_000,
    "evaluation_seed": 50_200_000,
}


def played(config, work) -> dict:
    """Do the jobs of a plan in this process, and compute the tables."""
    jobs = plan.jobs(config)
    for job in jobs:
        (work / job.name).mkdir(parents=True)
        inputs = {name: work / name for name in job.inputs}
        job.work(job.config, work / job.name, inputs, lambda _share: None)
    return compute_tables(config, Context(jobs, work, lambda _stage: None))._asdict()


def test_an_expert_is_imitated_and_pieces_are_taken_over(tmp_path) -> None:
    found = played(Config(**TINY, ablate=False), tmp_path / "work")
    (expert,) = found["tables"]["experts"]
    assert expert["updates"] == 40 and expert["best_checkpoint"] in (20, 40)
    rows = {row["method"]: row for row in found["tables"]["runs"]}
    assert set(rows) == {name for name, method in METHODS.items() if method.forces}
    policy = tmp_path / "work" / "expert" / "Hopper" / "expert.safetensors"
    again = returns(TASKS["Hopper"], ActorPolicy.load(policy), 2, 50_200_000).mean()
    assert expert["mean_return"] == pytest.approx(again)
    for row in rows.values():
        assert row["share"] == pytest.approx(row["mean_return"] / again)

    place = tmp_path / "results" / "pieces"
    place.mkdir(parents=True)
    for name, content in found["files"].items():
        (place.parent / name).write_bytes(content)
    there = str(place.parent)
    more = played(Config(**TINY, pieces=there), tmp_path / "more")
    assert [row["method"] for row in more["tables"]["ablations"]] == ["online", *TINY["variants"]]
    assert all(row in more["tables"]["runs"] for row in found["tables"]["runs"])
    assert len(more["files"]) == len(plan.committed(there)) + 2
    results = run(STUDY, Config(**TINY, pieces=there, new=False))
    save(STUDY, results, tmp_path / "shown", replace=False)
    assert (tmp_path / "shown" / "shares.png").is_file()


def test_the_committed_expert_has_its_returns() -> None:
    place = packaged_results() / "mujoco-imitation" / "pieces"
    expert = ActorPolicy.load(place / "Hopper_expert.safetensors")
    record = read_json(place / "Hopper_expert.json")
    found = returns(TASKS["Hopper"], expert, 2, record["recipe"]["evaluation_seed"])
    assert found.tolist() == pytest.approx(record["returns"][:2], rel=1e-3)
