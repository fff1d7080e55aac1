"""Configuration of the intersection study, its jobs, and the names of their folders."""

from collections.abc import Iterator, Mapping
from types import SimpleNamespace
from typing import Any

from socialiq.demonstrations.mixture import MIXTURES
from socialiq.errors import UserError, one_of
from socialiq.evaluation.rollout import MODES
from socialiq.learners import dqn
from socialiq.learners.iq_learn import config as presets
from socialiq.settings import changed, laid_over
from socialiq.types import Row
from socialiq.worlds.intersection.options import Options
from socialiq.worlds.intersection.policies import NAMES
from socialiq_lab.declared_settings import product_of, resolved
from socialiq_lab.intersection import driving
from socialiq_lab.intersection.driving import BEST, LAST, Driving, evaluation
from socialiq_lab.intersection.training import ExpertRun, LearnerRun, train_expert, train_learner
from socialiq_lab.jobs import Job
from socialiq_lab.registry import declaration

PARTS = ("main", "strengths", "targets", "data", "timeouts", "views")
"""Parts of the study, which STUDY.toml describes."""

TARGETS = ("baseline", *MODES)
PRESETS = {
    "thesis": (presets.INTERSECTION_THESIS, presets.INTERSECTION_THESIS_NUMBERS),
    "calibrated": (presets.INTERSECTION_CALIBRATED, presets.INTERSECTION_CALIBRATED_NUMBERS),
}
TRAINED = (("thesis", "online"), ("calibrated", "online"), ("calibrated", "offline"))
SHIPPED = ("calibrated", "online")
"""Group whose learners are drawn beside the thesis' and included in the atlas."""


EXPERT = (dqn.DQNConfig(), dqn.DQNHyperparameters())
DECIDED = ("angle", "dataset", "online", "seed", "steps", "updates")
"""Settings of experts and learners that the study decides, by settings of its own or by rows."""


def check(config: Any) -> None:
    """Refuse, by a `UserError`, settings of experts or learners that they lack or that are decided.

    Args:
        config: Configuration of the study.
    """
    for kind, of_kind in (("expert", EXPERT), ("learner", PRESETS["thesis"])):
        values = getattr(config, kind)
        for name in values.keys() & {*DECIDED}:
            raise UserError(
                f"{kind}.{name} is decided by the study: choose parts, seeds, expert_seed, "
                "expert_steps or updates"
            )
        laid_over(of_kind, values, DECIDED)


def jobs(config: Any) -> list[Job]:
    """Return every job of the chosen parts, each after its inputs."""
    for name in config.parts:
        one_of("part", name, PARTS)
    one_of("mixture", config.mixture, tuple(MIXTURES))
    planned = list(trainings(config))
    episodes = config.episodes
    for job in tuple(planned):
        if job.work is train_expert:
            planned.append(evaluation(job.name, Driving(driver=BEST, episodes=episodes), 3.0))
        if job.stage == "experts":
            angles = (job.config.numbers.angle,)
            run = Driving(driver=BEST, angles=angles, ahead="lookahead", episodes=episodes)
            name = f"evaluation/{job.name.replace('experts/', 'foresight/')}"
            planned.append(Job(name, driving.drive, run, (job.name,), cost=20.0))
        if job.work is train_learner:
            readouts = ("greedy", "soft")
            run = Driving(driver=LAST, readouts=readouts, episodes=episodes)
            planned.append(evaluation(job.name, run, 6.0))
    for name in NAMES:
        run = Driving(driver=name, episodes=episodes)
        planned.append(Job(f"evaluation/drivers/{name}", driving.drive, run, cost=3.0))
    for name, job in members(config).items():
        driver = policy_file(job)
        options = Options(connected_lanes=True)  # of the traffic
        run = Driving(driver=driver, episodes=episodes, options=options)
        planned.append(Job(f"connected/{name}", driving.drive, run, (job,), cost=3.0))
        if config.highway_episodes:
            first = driving.FIRST_HIGHWAY_EPISODE
            run = Driving(driver=driver, episodes=config.highway_episodes, first_seed=first)
            planned.append(Job(f"highway/{name}", driving.drive_highway, run, (job,), cost=100.0))
    return planned


def policy_file(job: str) -> str:
    """Return the file of a job's network that counts: an expert's best, a learner's last."""
    return LAST if job.startswith("learners/") else BEST


def learner_name(preset: str, setting: str, target: str, seed: int) -> str:
    """Return the folder of a learner of the main part.

    Args:
        preset: Name of the preset, from `PRESETS`.
        setting: "online" or "offline".
        target: Target of the learner, from `TARGETS`.
        seed: Training seed.
    """
    return f"learners/{preset}/{setting}/{target}/{seed}"


def columns(config: Any) -> dict[tuple[str, str], dict[str, list[str]]]:
    """Return the policies behind each column of Table 6.2, for experts and groups of learners."""
    experts = {f"expert {mode}": [f"experts/flat/{mode}/{config.expert_seed}"] for mode in MODES}
    return {("experts", "flat"): experts} | {
        group: {
            target: [learner_name(*group, target, seed) for seed in config.seeds]
            for target in TARGETS
        }
        for group in TRAINED
    }


def trainings(config: Any) -> Iterator[Job]:
    """Yield the jobs that STUDY.toml declares of the chosen parts, and the recording of experts."""
    half = {"half_expert_steps": config.expert_steps // 2}
    recording = driving.Recording(driver=BEST, episodes=config.pool_episodes)
    for declared in declaration("intersection")["training"]:
        if declared["part"] not in ("main", *config.parts):
            continue
        is_learner = "preset" in declared
        names: list[str] = []
        for values in product_of(resolved(declared["each"], config)):
            row = resolved(declared, SimpleNamespace(**{**vars(config), **half, **values}))
            run_of = learner_run if is_learner else expert_run
            run = run_of(config, row, values)
            work = train_learner if is_learner else train_expert
            inputs = (driving.DEMONSTRATIONS,) if is_learner else ()
            names.append(row["name"].format(**values))
            yield Job(names[-1], work, run, inputs, row["cost"])
        if declared["part"] == "main" and not is_learner:
            experts = tuple(names)
            yield Job(driving.DEMONSTRATIONS, driving.record_experts, recording, experts, 20.0)


def expert_run(config: Any, row: Row, values: Mapping[str, Any]) -> ExpertRun:
    """Return the run of an expert.

    Args:
        config: Configuration of the study; what a training changes goes before its `expert`.
        row: The declared training, with the values of this run.
        values: These values by name, `mode` among them or not.
    """
    angle = {"angle": MODES[values["mode"]]} if "mode" in values else {}
    structure, numbers = laid_over(EXPERT, config.expert)
    structure = changed(structure, row["static"])
    return ExpertRun(structure, changed(numbers, row["numbers"] | angle))


def learner_run(config: Any, row: Row, values: Mapping[str, Any]) -> LearnerRun:
    """Return the run of a learner, towards a mode's angle, or of the baseline.

    Args:
        config: Configuration of the study; what a training changes goes before its `learner`.
        row: The declared training, with the values of this run.
        values: These values by name.
    """
    structure, numbers = laid_over(PRESETS[row["preset"]], config.learner)
    structure = changed(structure, row["static"])
    if row.get("setting") == "offline":
        structure = presets.offline(structure)
    if values["target"] == "baseline":
        structure = presets.baseline(structure)
    changes = {"angle": MODES.get(values["target"], 0.0), "seed": values["seed"]}
    numbers = changed(numbers, row.get("numbers", {}) | changes)
    mixture = row.get("mixture", config.mixture)
    return LearnerRun(structure, numbers, mixture, values.get("size", config.size))


def members(config: Any) -> dict[str, str]:
    """Return the folder of the job of each policy of the atlas: experts, and the first seed's."""
    experts = columns(config)["experts", "flat"]
    learners = columns(config)[SHIPPED]
    policies = {name.replace(" ", "_"): folders[0] for name, folders in experts.items()}
    return policies | {target: folders[0] for target, folders in learners.items()}
