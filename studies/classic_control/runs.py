"""Jobs of the study: one for each task, protocol and method, over all sets and seeds."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize

from socialiq import Demonstrations, rollout_env, train
from socialiq.demonstrations.variants import with_images
from socialiq.learners import acting, settings
from socialiq.learners import behaviour_cloning as bc
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.iq_learn import config as presets
from socialiq.storage import write_json
from socialiq.types import Row
from socialiq_lab.comparison import Recipe, declared_recipes
from socialiq_lab.jobs import ProgressCallback, callbacks_of
from socialiq_lab.registry import declaration
from studies.classic_control.tasks import TASKS, CartPole, Task, make_env, returns

PROTOCOLS = ("rows", "stride", "whole")
"""One random row of each block, the first row of each block, or all rows."""

CHUNK = 250  # updates between two rounds of acting, in environments outside compiled programs
ROWS = "rows.json"


@dataclasses.dataclass(frozen=True)
class Method(Recipe):
    """A learner with its settings, a table `[method.NAME]` of STUDY.toml."""

    mirrored: bool = False  # whether the mirror images of the demonstrations are given
    scaled: bool = True  # whether the features are multiplied by the task's common factor


_FEW, _FEW_NUMBERS = presets.PRESETS["few-offline"]
_CLONING = {f.name: getattr(_FEW, f.name) for f in dataclasses.fields(settings.LearnerConfig)}
_RATE = bc.CloningHyperparameters(learning_rate=_FEW_NUMBERS.learning_rate)
_BASES = {
    "few-offline": Method(_FEW, _FEW_NUMBERS),
    "few-online": Method(*presets.PRESETS["few-online"]),
    "cloning": Method(bc.CloningConfig(**_CLONING), _RATE),
    "defaults": Method(presets.IQLearnConfig(), presets.IQLearnHyperparameters()),
}
_DECLARED = declaration("classic-control")
METHODS = declared_recipes(_DECLARED["method"], _BASES)
PUBLISHED = declared_recipes(_DECLARED["published"], _BASES)
VARIANTS = declared_recipes(_DECLARED["variant"], METHODS)
RECIPES = METHODS | PUBLISHED | VARIANTS
VARIED = {variant["of"] for variant in _DECLARED["variant"].values()}
"""Methods of which there are variants."""


def learn(
    task: Task,
    method: Method,
    datasets: Sequence[Demonstrations],
    seeds: Sequence[int],
    updates: int,
    callbacks: Callbacks,
) -> Any:
    """Train one run for each set and seed, the seeds of a set side by side."""
    scale = task.input_scale if method.scaled else 1.0
    updates = updates or method.static.updates
    static = dataclasses.replace(method.static, updates=updates, input_scale=scale)
    runs = [
        dataclasses.replace(method.numbers, seed=seed, dataset=index)
        for index in range(len(datasets))
        for seed in seeds
    ]
    if isinstance(static, bc.CloningConfig):
        return bc.BehaviourCloning.train_on(static, runs, datasets, callbacks)
    if not method.online:
        return train(static, runs, datasets, callbacks=callbacks)
    if task.env == "CartPole-v1":
        return train(static, runs, datasets, CartPole(), callbacks)
    static = dataclasses.replace(static, env_steps_per_update=1)  # they cost more than an update
    collect = acting.acting_in(lambda: make_env(task), static, runs, CHUNK)
    return train(static, runs, datasets, None, callbacks, CHUNK, collect)


@dataclasses.dataclass(frozen=True)
class Source:
    """Sets of demonstrations; set i begins with the episode of seed + i * trajectories."""

    task: str
    protocol: str
    trajectories: int
    sets: int
    seed: int
    episodes: int
    evaluation_seed: int

    def whole_trajectories(self) -> list[Demonstrations]:
        """Return the whole trajectories of each set."""
        episodes = trajectories(TASKS[self.task], self.sets * self.trajectories, self.seed)
        sets = np.arange(episodes.n_episodes).reshape(self.sets, self.trajectories)
        return [episodes.select(chosen) for chosen in sets]

    def thinned(self, sets: Sequence[Demonstrations], mirrored: bool) -> list[Demonstrations]:
        """Return what learners are given of each set."""
        return [
            thinned(episodes, self.protocol, TASKS[self.task], self.seed + number, mirrored)
            for number, episodes in enumerate(sets)
        ]

    def label(self) -> Row:
        """Return the columns that name it."""
        return {"task": self.task, "protocol": self.protocol, "trajectories": self.trajectories}

    def score(self, act: Callable[[np.ndarray], np.ndarray]) -> float:
        """Return the mean return of a policy."""
        task = TASKS[self.task]
        return float(returns(task, act, self.episodes, self.evaluation_seed).mean())


def trajectories(task: Task, count: int, seed: int) -> Demonstrations:
    """Return whole episodes of the task's expert; episode i is reset with seed + i."""
    return rollout_env(make_env(task), task.expert, count, seed).transitions


def thinned(
    episodes: Demonstrations, protocol: str, task: Task, seed: int, mirrored: bool
) -> Demonstrations:
    """Return what a learner is given of whole trajectories, by one of `PROTOCOLS`."""
    rows = episodes
    if protocol == "rows":
        rows = episodes.one_of_each_block(task.every, seed)
    elif protocol == "stride":
        rows = episodes.subsample(task.every)
    return with_images(rows, task.symmetry) if mirrored else rows


@dataclasses.dataclass(frozen=True)
class Training:
    """Training of one method on every set, with every training seed."""

    source: Source
    method: str
    seeds: tuple[int, ...]
    updates: int


def train_and_score(
    run: Training, folder: Path, _inputs: Mapping[str, Path], progress: ProgressCallback
) -> None:
    """Train; write the mean return of each policy and of each set's ensemble."""
    source, method = run.source, RECIPES[run.method]
    sets = source.thinned(source.whole_trajectories(), method.mirrored)
    callbacks = callbacks_of(progress)
    trained = learn(TASKS[source.task], method, sets, run.seeds, run.updates, callbacks)
    rows: list[Row] = []

    def score(policies: Sequence[Any]) -> float:  # greedy by the mean of Q - mean Q
        def act(observations: np.ndarray) -> np.ndarray:
            values = [policy.q_values(observations) for policy in policies]
            advantages = [q - q.mean(axis=1, keepdims=True) for q in values]
            return np.mean(advantages, axis=0).argmax(axis=1)

        return source.score(act)

    for index, rows_of_set in enumerate(sets):
        label = source.label() | {"method": run.method, "set": index}
        label["rows"] = rows_of_set.n_transitions
        first = index * len(run.seeds)
        policies = [trained.policy(first + number) for number in range(len(run.seeds))]
        entries = {str(seed): [policy] for seed, policy in zip(run.seeds, policies, strict=True)}
        for seed, voters in (entries | {"ensemble": policies}).items():
            rows.append(label | {"seed": seed, "mean_return": score(voters)})
    write_json(folder / ROWS, rows)


@dataclasses.dataclass(frozen=True)
class Inspection:
    """A look at the sets themselves, without a learner."""

    source: Source
    shrinkages: tuple[float, ...]


def inspect(
    run: Inspection, folder: Path, _inputs: Mapping[str, Path], progress: ProgressCallback
) -> None:
    """Write each set's expert return, and of CartPole cycle, spread and linear fits' returns."""
    source, sets = run.source, run.source.whole_trajectories()
    rows: list[Row] = []
    for number, (episodes, data) in enumerate(zip(sets, source.thinned(sets, False), strict=True)):
        row = source.label() | {"set": number, "rows": data.n_transitions}
        row["expert_return"] = float(episodes.totals().env.mean())
        if TASKS[source.task].env == "CartPole-v1":
            shift, share = cycle(episodes)
            row |= {"cycle": shift, "equal": share, "spread_kept": spread_kept(data, episodes)}
            for shrinkage in run.shrinkages:
                weights = linear_fit(data, shrinkage)

                def act(observation: np.ndarray, weights: np.ndarray = weights) -> np.ndarray:
                    return (observation @ weights > 0).astype(int)

                row[f"linear_{shrinkage:g}"] = source.score(act)
        rows.append(row)
    write_json(folder / ROWS, rows)
    progress(1.0)


def cycle(episodes: Demonstrations) -> tuple[int, float]:
    """Return the shift of 2 to 12 steps under which most actions stay equal, and their share."""
    action = episodes.action[episodes.episode == 0]
    action = action[len(action) // 2 :]  # after the transient
    shifts = range(2, min(13, len(action)))
    shares = {shift: float(np.mean(action[shift:] == action[:-shift])) for shift in shifts}
    shift = max(shares, key=lambda entry: shares[entry])
    return shift, shares[shift]


def spread_kept(data: Demonstrations, episodes: Demonstrations) -> float:
    """Return the least share of a feature's deviation that a thinned set has after 100 steps."""
    deviations = [rows.observation[rows.step >= 100].std(axis=0) for rows in (data, episodes)]
    return float(np.min(deviations[0] / deviations[1]))


def linear_fit(data: Demonstrations, shrinkage: float) -> np.ndarray:
    """Fit w of P(right) = logistic(w s), the class of CartPole's experts, by `shrinkage` |w|²."""
    features = data.observation.astype(float) / 0.1
    side = 2.0 * data.action - 1.0

    def loss(weights: np.ndarray) -> tuple[float, np.ndarray]:
        margin = side * (features @ weights)
        wrong = 0.5 * (1.0 - np.tanh(0.5 * margin))  # the logistic function of -margin
        slope = -(side * wrong) @ features + 2.0 * shrinkage * weights
        return float(np.logaddexp(0.0, -margin).sum() + shrinkage * weights @ weights), slope

    return minimize(loss, np.zeros(features.shape[1]), jac=True, method="BFGS").x
