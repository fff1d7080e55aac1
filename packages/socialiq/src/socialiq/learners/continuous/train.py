"""Training with continuous actions: in a compiled world, in one outside JAX, or offline."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax

from socialiq.errors import UserError
from socialiq.learners import settings
from socialiq.learners.behaviour_cloning import GaussianCloning
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.continuous.actor_critic import ActorCritic
from socialiq.learners.continuous.iq_learn import ContinuousIQLearn
from socialiq.learners.continuous.sac import TD3BC, SoftActorCritic
from socialiq.learners.expert_table import ExpertTable
from socialiq.learners.fit import BeforeChunk
from socialiq.learners.iq_learn.objective import OURS, UserFunctions
from socialiq.learners.kernel import Learner, Trained
from socialiq.nn.q_network import encoding
from socialiq.types import ContinuousSimulator, Transitions

LEARNERS: dict[str, type[Learner]] = {
    "iq-learn": ContinuousIQLearn,
    "sac": SoftActorCritic,
    "td3-bc": TD3BC,
    "behaviour-cloning": GaussianCloning,
}
"""Learners of continuous actions by name."""


def train(
    static: Any,
    hyperparameters: settings.LearnerHyperparameters | Sequence[Any],
    datasets: Transitions | Sequence[Transitions] = (),
    simulator: ContinuousSimulator | None = None,
    sizes: tuple[int, int] | None = None,
    callbacks: Callbacks | None = None,
    chunk: int = 500,
    before_chunk: BeforeChunk | None = None,
    user_functions: UserFunctions = OURS,
) -> Trained:
    """Train one run for each entry of `hyperparameters`, as `learners.iq_learn.train.train`.

    Args:
        static: Config of all runs, whose class says which learner: `ContinuousIQLearn`,
            `SoftActorCritic` or `TD3BC`.
        hyperparameters: Numbers of each run, or those of one run.
        datasets: Sets of demonstrations, or one set.
        simulator: The world to act in; None offline, or when `before_chunk` fills the replay.
        sizes: Length of an observation and of an action, needed only where neither demonstrations
            nor a simulator tell.
        callbacks: Progress, monitor, checkpoint.
        chunk: Updates between two calls of the callbacks.
        before_chunk: Adds experience from outside JAX (`learners.collect`).
        user_functions: Prior and divergence of the user's own, of IQ-Learn only.

    Returns:
        The trained runs.

    Raises:
        UserError: If settings, data and world don't fit together.
        Stopped: On Ctrl-C.
    """
    runs, sets = settings.listed(hyperparameters, datasets, simulator)
    sizes = check_fit(static, runs, sets, simulator, sizes, before_chunk is not None)
    learner = learner_of(static)
    table = None
    if learner.shown:
        kind = getattr(static, "target_kind", "instantaneous")
        kind = "instantaneous" if getattr(static, "prior", "") == "none" else kind
        discount = getattr(static, "social_discount", 1.0)
        table = ExpertTable.of(sets, kind, discount, continuous=True)
    functions = {"own": user_functions} if issubclass(learner, ContinuousIQLearn) else {}
    instance = learner(static, sizes, table, simulator, **functions)
    world = simulator.description if simulator else "offline or collected"
    return instance.train(runs, callbacks, chunk, before_chunk, world)


def learner_of(static: Any) -> type[ActorCritic]:
    """Return the learner that has this class of config."""
    learners = (ContinuousIQLearn, SoftActorCritic, TD3BC)
    return next(learner for learner in learners if isinstance(static, learner.StaticConfig))


def check_fit(
    static: Any,
    hyperparameters: Sequence[Any],
    datasets: Sequence[Transitions],
    simulator: ContinuousSimulator | None,
    sizes: tuple[int, int] | None,
    collects: bool,
) -> tuple[int, int]:
    """Return (features, length of an action) of runs that fit data and world.

    Args:
        static: Config of all runs.
        hyperparameters: Numbers of each run.
        datasets: Sets of demonstrations.
        simulator: The world to act in; None without.
        sizes: (features, length of an action) that the caller gives; None if data or world tell.
        collects: Whether experience comes from outside JAX.

    Returns:
        The sizes.

    Raises:
        UserError: As `settings.check_fit`; or if data have no use or discrete actions, a dial has
            an angle, or a view doesn't fit the observation.
    """
    learner = learner_of(static)
    if datasets and not learner.shown:
        raise UserError(f"{learner.name} learns from no demonstrations: leave them out")
    if any(data.action.ndim != 2 for data in datasets):
        raise UserError("the demonstrations have discrete actions: use a learner of these")
    if static.dial and any(run.angle for run in hyperparameters):
        raise UserError("a dial is trained for all angles from low to high: leave out --angle")
    shapes = [(data.observation.shape[1], data.action.shape[1]) for data in datasets]
    shapes += [(simulator.n_features, simulator.action_size)] if simulator is not None else []
    online = getattr(static, "online", learner.online)
    acts = simulator is not None or collects
    if static.dial and not online:
        settings.check_social(datasets)
    sets = len(datasets) if learner.shown else None
    shape = settings.check_fit(
        hyperparameters, sets, online, acts, [*shapes, sizes] if sizes else shapes
    )
    encoding(jax.random.key(0), shape[0], static.view, (), static.times)  # refuses a misfit
    return shape
