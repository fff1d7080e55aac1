"""Tasks, methods, and the jobs: experts, their demonstrations, and what learns from them."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import gymnasium
import numpy as np

from socialiq import Demonstrations, UserError, acting_in, make_environment, rollout_env
from socialiq.demonstrations import files, variants
from socialiq.learners import behaviour_cloning as bc
from socialiq.learners.acting import drawing
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.collect import Collector, from_env
from socialiq.learners.continuous import config
from socialiq.learners.continuous.standardise import Standardisation
from socialiq.learners.continuous.train import train
from socialiq.nn import actor_policy, q_network
from socialiq.settings import changed
from socialiq.storage import read_json, write_json
from socialiq.types import Policy
from socialiq.worlds.environment import action_size, sizes
from socialiq.worlds.wrapper import AbsorbingStates
from socialiq_lab.comparison import Recipe, declared_recipes
from socialiq_lab.declared_settings import settings_of
from socialiq_lab.jobs import Inputs, ProgressCallback, callbacks_of
from socialiq_lab.registry import declaration


@dataclasses.dataclass(frozen=True)
class ExpertSettings:
    """Settings of an expert's training, with a step in the environment for each update."""

    updates: int
    hidden: tuple[int, ...] = (64, 64)
    batch_size: int = 128
    learning_rate: float = 1e-3
    schedule: Literal["constant", "linear"] = "constant"


@dataclasses.dataclass(frozen=True)
class Task:
    """An environment, and what its policies take."""

    env: str
    expert: ExpertSettings
    online_updates: int
    published: float
    """Mean return of IQ-Learn online from one trajectory (Garg et al. 2021), of another expert."""
    forces: range = range(0)  # features that are contact forces


_DECLARED = declaration("mujoco-imitation")
TASKS: dict[str, Task] = {}  # tasks by name in the tables
for _name, _row in _DECLARED["task"].items():
    _expert = changed(ExpertSettings(0), _row["expert"])
    TASKS[_name] = Task(**_row | {"expert": _expert, "forces": range(*_row.get("forces", (0,)))})


def make_env(task: Task) -> gymnasium.Env[Any, Any]:
    """Make a task's environment, with actions in [-1, 1].

    Raises:
        UserError: If MuJoCo is not installed.
    """
    try:
        return make_environment(task.env, continuous=True)
    except UserError as error:
        if isinstance(error.__cause__, gymnasium.error.DependencyNotInstalled):
            raise UserError(
                f"{task.env} needs an extra: pip install 'socialiq-lab[mujoco]'"
            ) from error
        raise


def played(task: Task, policy: Policy, episodes: int, seed: int) -> Demonstrations:
    """Return episodes of a policy's mean actions.

    Args:
        task: Task whose environment is driven.
        policy: Policy that acts.
        episodes: Number of episodes.
        seed: Seed of the first reset; episode i is reset with seed + i.
    """
    return rollout_env(make_env(task), policy, episodes, seed).transitions


def returns(task: Task, policy: Policy, episodes: int, seed: int) -> np.ndarray:
    """Return the undiscounted return of each episode of a policy's mean actions.

    Args:
        task: Task whose environment is driven.
        policy: Policy that acts.
        episodes: Number of episodes.
        seed: Seed of the first reset; episode i is reset with seed + i.
    """
    return np.asarray(played(task, policy, episodes, seed).totals().env, np.float64)


POLICY = "expert.safetensors"
RECORD = "expert.json"
SHOWN = "shown.safetensors"
ROUND = 1000
"""Updates, and steps in the environment, between two rounds of acting: the greatest length of an
episode."""


@dataclasses.dataclass(frozen=True)
class Method(Recipe):
    """A learner with its settings, a table `[method.NAME]` of STUDY.toml."""

    clone: str = ""  # cloning that it is tested against
    absorbing: bool = False  # whether terminal states are absorbing ones that the observation shows
    standardised: bool = False
    updates: int = 0  # of online imitation; 0 for those of the task
    forces: bool = True  # whether the networks see contact forces, of tasks that have them


_BASES = {
    name: Method(*(settings_of(name, **settings) for settings in base.values()))
    for name, base in _DECLARED["base"].items()
}
METHODS: dict[str, Method] = declared_recipes(_DECLARED["method"], _BASES)
"""Methods by name in the tables."""

VARIANTS: dict[str, Method] = declared_recipes(_DECLARED["variant"], METHODS)
"""Ablations of online imitation by name in the tables."""

RECIPES = METHODS | VARIANTS


@dataclasses.dataclass(frozen=True)
class Expert:
    """Recipe of an expert: the best of its checkpoints, by `judged` episodes for each."""

    task: str
    seed: int
    settings: ExpertSettings
    every: int
    judged: int
    judging_seed: int
    episodes: int
    evaluation_seed: int


def train_expert(recipe: Expert, folder: Path, _inputs: Inputs, progress: ProgressCallback) -> None:
    """Train, or go on; write the best checkpoint, and the returns of all.

    Args:
        recipe: Task, settings, and episodes by which checkpoints are judged.
        folder: Folder of the job; it gets the policy and its record.
        progress: Callback of the finished share, 0 to 1.
    """
    task = TASKS[recipe.task]
    settings = recipe.settings
    checkpoint = folder / "training.safetensors"

    def judge(state: Any) -> dict[str, np.ndarray]:  # keeps the best checkpoint
        done = int(np.asarray(state.optimiser.count)[0])
        if done % recipe.every and done != settings.updates:
            return {}
        record = read_json(folder / RECORD) if (folder / RECORD).is_file() else {"checkpoints": []}
        past = [entry for entry in record["checkpoints"] if entry["updates"] < done]
        policy = actor_policy.ActorPolicy.of(q_network.network_of(state.network.actor, 0), {})
        seed = recipe.judging_seed + len(past) * recipe.judged
        mean = float(returns(task, policy, recipe.judged, seed).mean())
        if mean > max((entry["mean_return"] for entry in past), default=-np.inf):
            policy.save(folder / POLICY)
        past.append({"updates": done, "mean_return": mean})
        write_json(folder / RECORD, {"checkpoints": past})
        return {}

    shape = {k: v for k, v in vars(settings).items() if k != "learning_rate"}
    static = config.SACConfig(
        **shape,
        updates_per_round=min(ROUND, settings.updates),
        random_steps=5 * ROUND,
        replay_capacity=min(settings.updates, 300_000),
        tuned=True,
    )
    runs = [config.SACHyperparameters(seed=recipe.seed, learning_rate=settings.learning_rate)]
    env = make_env(task)
    train(
        static,
        runs,
        sizes=(sizes(env)[0], action_size(env)),
        callbacks=callbacks_of(progress, checkpoint, judge),
        chunk=static.updates_per_round,
        before_chunk=acting_in(lambda: make_env(task), static, runs, static.updates_per_round),
    )
    checkpoint.unlink(missing_ok=True)
    expert = actor_policy.ActorPolicy.load(folder / POLICY)
    episode_returns = returns(task, expert, recipe.episodes, recipe.evaluation_seed)
    described = dataclasses.asdict(recipe)
    described |= described.pop("settings")
    entries = {"recipe": described, "returns": episode_returns.tolist()}
    write_json(folder / RECORD, read_json(folder / RECORD) | entries)


@dataclasses.dataclass(frozen=True)
class Imitation:
    """Training of one method in one program; each seed has its own set, an input."""

    task: str
    method: str
    trajectories: int
    seeds: tuple[int, ...]
    updates: int
    episodes: int
    evaluation_seed: int


def imitate(run: Imitation, folder: Path, inputs: Inputs, progress: ProgressCallback) -> None:
    """Train and write the piece of each seed; an interrupted training goes on.

    Args:
        run: Task, method, seeds and evaluation episodes.
        folder: Folder of the job; it gets a file for each seed.
        inputs: Folder of the demonstrations of each seed, in the order of the seeds.
        progress: Callback of the finished share, 0 to 1.
    """
    task = TASKS[run.task]
    method = settled(run)
    datasets = [
        files.load(path / SHOWN, continuous=True).select(np.arange(run.trajectories))
        for path in inputs.values()
    ]
    checkpoint = folder / "training.safetensors"
    policies = learn(task, method, datasets, run.seeds, callbacks_of(progress, checkpoint))
    for number, (seed, policy) in enumerate(zip(run.seeds, policies, strict=True)):
        if method.absorbing:  # the mark of absorbing states, the last feature, is 0
            first, *later = policy.weights
            policy = dataclasses.replace(policy, weights=(first[:, :-1], *later))
        record = policy.provenance
        if "standardised" in record:  # only that it is there
            record = {**record, "standardised": True}
        piece = {
            "task": run.task,
            "method": run.method,
            "trajectories": run.trajectories,
            "seed": seed,
            "updates": method.static.updates,
            "evaluation_seed": run.evaluation_seed,
            "demonstrated_return": float(datasets[number].totals().env.mean()),
            "returns": returns(task, policy, run.episodes, run.evaluation_seed).tolist(),
            "record": record,
        }
        write_json(folder / f"{seed}.json", piece)
    checkpoint.unlink(missing_ok=True)


def settled(run: Imitation) -> Method:
    """Return a run's method with its updates: the given ones, its own, or online the task's."""
    method = RECIPES[run.method]
    changes = {}
    updates = method.static.updates
    if method.online:
        updates = method.updates or TASKS[run.task].online_updates
        changes["updates_per_round"] = min(ROUND, run.updates or updates)
    return changed(method, {"static": changes | {"updates": run.updates or updates}})


def learn(
    task: Task,
    method: Method,
    datasets: Sequence[Demonstrations],
    seeds: Sequence[int],
    callbacks: Callbacks,
) -> list[actor_policy.ActorPolicy]:
    """Train a run for each seed, each on its own set, all in one program.

    Args:
        task: Task whose environment online methods act in.
        method: Learner with its settings.
        datasets: Set of demonstrations of each seed.
        seeds: Training seeds.
        callbacks: Progress and checkpoint.

    Returns:
        Policy of each seed.
    """

    def environment() -> Any:
        env = make_env(task)
        return AbsorbingStates(env) if method.absorbing else env

    if method.absorbing:
        datasets = [variants.with_absorbing_states(dataset) for dataset in datasets]
    changes = []
    makers = [environment] * len(seeds)
    if method.standardised:
        unseen = () if method.forces else task.forces
        changes = [Standardisation.of(dataset.observation, unseen) for dataset in datasets]
        pairs = zip(changes, datasets, strict=True)
        datasets = [change.transitions(dataset) for change, dataset in pairs]
        makers = [change.maker(environment) for change in changes]
    runs = [
        dataclasses.replace(method.numbers, seed=seed, dataset=number)
        for number, seed in enumerate(seeds)
    ]
    if isinstance(method.static, bc.CloningConfig):
        trained = bc.GaussianCloning.train_on(method.static, runs, datasets, callbacks)
    else:
        options: dict[str, Any] = {"callbacks": callbacks}
        if method.online:
            chunk = method.static.updates_per_round
            sources = [from_env(make(), chunk, continuous=True) for make in makers]
            collect = Collector(sources, seeds, drawing(method.static, 1))
            options |= {"chunk": chunk, "before_chunk": collect}
        trained = train(method.static, runs, datasets, **options)
    policies = [trained.policy(run) for run in range(len(runs))]
    if not changes:
        return policies
    return [change.policy(policy) for change, policy in zip(changes, policies, strict=True)]
