"""Training with continuous actions: in a compiled world, in one outside JAX, or offline."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import gymnasium
import jax

from socialiq.errors import UserError
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.collect import Collector, from_env
from socialiq.learners.continuous.acting import drawing
from socialiq.learners.continuous.actor_critic import ActorCritic
from socialiq.learners.continuous.behaviour_cloning import BehaviourCloning
from socialiq.learners.continuous.iq_learn import ContinuousIQLearn
from socialiq.learners.continuous.sac import TD3BC, SoftActorCritic
from socialiq.learners.expert_table import ExpertTable
from socialiq.learners.fit import BeforeChunk
from socialiq.learners.iq_learn.objective import OURS, UserFunctions
from socialiq.learners.kernel import Learner, Trained
from socialiq.learners.settings import check_runs
from socialiq.nn.q_network import encoding
from socialiq.types import ContinuousSimulator, Transitions

LEARNERS: dict[str, type[Learner]] = {
    "iq-learn": ContinuousIQLearn,
    "sac": SoftActorCritic,
    "td3-bc": TD3BC,
    "behaviour-cloning": BehaviourCloning,
}
"""Learners of continuous actions by name."""


def train(
    learner: type[ActorCritic],
    static: Any,
    hyperparameters: Sequence[Any],
    datasets: Sequence[Transitions] = (),
    simulator: ContinuousSimulator | None = None,
    sizes: tuple[int, int] | None = None,
    callbacks: Callbacks | None = None,
    chunk: int = 500,
    before_chunk: BeforeChunk | None = None,
    own: UserFunctions = OURS,
) -> Trained:
    """Train one run for each entry of `hyperparameters`, all in one compiled program.

    Args:
        learner: `ContinuousIQLearn`, `SoftActorCritic` or `TD3BC`.
        static: Its `StaticConfig`, shared by all runs.
        hyperparameters: Its `Hyperparameters`, one entry for each run.
        datasets: Sets of demonstrations; `Hyperparameters.dataset` picks the set of each run. None
            for a learner without.
        simulator: The world to act in; None offline, or when `before_chunk` fills the replay.
        sizes: Length of an observation and of an action; needed only where neither demonstrations
            nor a simulator tell.
        callbacks: Progress, monitor, checkpoint.
        chunk: Updates between two calls of the callbacks.
        before_chunk: Adds experience from outside JAX (`acting_in`).
        own: Prior and divergence of the user's own; only of IQ-Learn.

    Raises:
        UserError: If settings, data and world don't fit together.
        Stopped: On Ctrl-C.
    """
    sizes = check_fit(
        learner, static, hyperparameters, datasets, simulator, sizes, before_chunk is not None
    )
    table = None
    if learner.shown:
        kind = getattr(static, "target_kind", "instantaneous")
        kind = "instantaneous" if getattr(static, "prior", "") == "none" else kind
        discount = getattr(static, "social_discount", 1.0)
        table = ExpertTable.of(datasets, kind, discount, continuous=True)
    functions = {"own": own} if issubclass(learner, ContinuousIQLearn) else {}
    instance = learner(static, sizes, table, simulator, **functions)
    world = simulator.description if simulator else "offline or collected"
    return instance.train(hyperparameters, callbacks, chunk, before_chunk, world)


def acting_in(
    make: Callable[[], gymnasium.Env[Any, Any]], static: Any, hyperparameters: Sequence[Any]
) -> Collector:
    """Let runs act in a Gymnasium environment: the `before_chunk` of `train`.

    Args:
        make: Makes the environment, with actions in [-1, 1], once for each run.
        static: Of the runs; `updates_per_round` has to be the `chunk` of `train`.
        hyperparameters: Of each run.

    Raises:
        UserError: If the actions are not arrays in [-1, 1].
    """
    steps = static.updates_per_round * static.env_steps_per_update
    sources = [from_env(make(), steps, continuous=True) for _ in hyperparameters]
    behaviour = drawing(static, static.env_steps_per_update)
    return Collector(sources, [run.seed for run in hyperparameters], behaviour)


def check_fit(
    learner: type[ActorCritic],
    static: Any,
    hyperparameters: Sequence[Any],
    datasets: Sequence[Transitions],
    simulator: ContinuousSimulator | None,
    sizes: tuple[int, int] | None,
    collects: bool,
) -> tuple[int, int]:
    """Refuse runs whose settings, data and world don't fit together, before any work is done.

    Returns:
        Length of an observation and of an action.

    Raises:
        UserError: The line says what doesn't fit.
    """
    if datasets and not learner.shown:
        raise UserError(f"{learner.name} learns from no demonstrations: leave them out")
    online = getattr(static, "online", learner.online)
    sets = len(datasets) if learner.shown else None
    check_runs(hyperparameters, sets, online, simulator is not None or collects)
    if static.dial and any(run.angle for run in hyperparameters):
        raise UserError("a dial is trained for all angles from low to high: leave the angle out")
    shapes = [(data.observation.shape[1], _size(data)) for data in datasets]
    shapes += [(simulator.n_features, simulator.action_size)] if simulator is not None else []
    shapes += [sizes] if sizes else []
    if len(set(shapes)) != 1:
        raise UserError(
            "data and world differ in features and in the size of an action: "
            f"{sorted(set(shapes))}: they belong to two worlds"
        )
    encoding(jax.random.key(0), shapes[0][0], static.view, (), static.times)  # refuses a misfit
    return shapes[0]


def _size(data: Transitions) -> int:
    if data.action.ndim != 2:
        raise UserError("the demonstrations have discrete actions: use a learner of these")
    return int(data.action.shape[1])
