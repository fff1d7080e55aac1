"""`train` with continuous actions: actors by IQ-Learn, soft actor-critic, TD3+BC or cloning."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from socialiq.cli.options import overridden
from socialiq.cli.run_folder import CHUNK, RunFolder, described_file
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError, one_of
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.continuous.behaviour_cloning import BehaviourCloning
from socialiq.learners.continuous.presets import PRESETS
from socialiq.learners.continuous.standardise import Standardisation, explored
from socialiq.learners.continuous.train import LEARNERS, acting_in, check_fit, train
from socialiq.learners.continuous.vector_acting import ActorVectorCollector
from socialiq.learners.kernel import Learner, Trained
from socialiq.worlds import CONTINUOUS
from socialiq.worlds.environment import action_size, continuous_maker, sizes
from socialiq.worlds.intersection.actions import width
from socialiq.worlds.intersection.gym import intersections
from socialiq.worlds.intersection.world import Intersection
from socialiq.worlds.registry import continuous_options, refuse_file

NO_PRESET = "grid"  # the default of `train`, which is of discrete actions
SIDE_BY_SIDE = 24
"""Episodes of the intersection side by side, of each run."""


def run(command: Any, data: Demonstrations | None) -> int:
    """Train, write the folder, print what came out.

    Args:
        command: A `train.Train`.
        data: Demonstrations of continuous actions; None without.

    Raises:
        UserError: If an option is of discrete actions, or settings, data and world don't fit
            together.
    """
    learner = _learner(command)
    static, runs = settings(command, learner)
    folder = RunFolder(
        command.out,
        "dial" if getattr(static, "dial", False) else "policy",
        command.resume,
        command.tensorboard,
    )
    change = _standardisation(command, static, data, runs[0].seed)
    seen = change.transitions(data) if change is not None and data is not None else data
    prepared = _prepared(command, learner, static, runs, seen, change)
    labels = [command.label(one) for one in runs]
    with folder.callbacks(labels) as callbacks:
        trained = prepared(callbacks)
    policies = command.policies(folder, trained, change.policy if change else None)
    renamed = [
        {"angle_target" if key == "angle" else key: value for key, value in one.items()}
        for one in labels
    ]
    record: dict[str, Any] = {"world": command.world}
    if data is not None:
        record["data"] = described_file(command.data) | {"transitions": data.n_transitions}
    folder.finish(trained, renamed, policies, record)
    return folder.report(trained, policies, command.json)


def settings(command: Any, learner: type[Learner]) -> tuple[Any, list[Any]]:
    """Return the learner's config with the options laid over it, and the grid of runs."""
    own = {"online": bool(command.world)} if learner is LEARNERS["iq-learn"] else {}
    # Options of both kinds in one step: a config is checked as a whole.
    given = (command.static, command.continuous, command.critics)
    structure, numbers = _begun(command, learner)
    static = overridden(structure, *given, **own)
    base = overridden(
        numbers,
        command.hyperparameters,
        command.tuning,
        command.towards_data,
    )
    return static, command.grid(base)


def _learner(command: Any) -> type[Learner]:
    """Return the learner's class, after a check of the options that only discrete ones have."""
    if command.loss:
        raise UserError("--loss is of discrete actions: leave it out")
    for name in ("prior", "divergence"):
        if ":" in (getattr(command.static, name) or ""):
            raise UserError(
                f"a {name} of your own with continuous actions is for Python: pass it to "
                "learners.continuous.train"
            )
    named = command.learner or "iq-learn"
    one_of("learner of continuous actions", named, tuple(LEARNERS))
    return LEARNERS[named]


def _standardisation(
    command: Any, static: Any, data: Demonstrations | None, seed: int
) -> Standardisation | None:
    """Return the change of observations that the command asks for.

    Raises:
        UserError: If there is nothing to standardise by, a view reads observations, or features
            can't be left out.
    """
    if not command.standardise:
        if command.leave_out:
            raise UserError("--leave-out is of standardised observations: add --standardise")
        return None
    if command.world in CONTINUOUS or static.view != "flat":
        raise UserError("observations of vehicles are scaled already: leave --standardise out")
    if data is not None:
        return Standardisation.of(data.observation, command.leave_out)
    if not command.world:
        raise UserError("--standardise is by demonstrations or a world: name one with --world")
    make = continuous_maker(command.world, None, command.allow_code)
    return Standardisation.of(explored(make(), seed), command.leave_out)


def _begun(command: Any, learner: type[Learner]) -> tuple[Any, Any]:
    """Return the settings to begin with: the learner's own, or those of the preset.

    Raises:
        UserError: If the preset is of discrete actions, or of another learner or world.
    """
    if command.preset == NO_PRESET:
        return learner.StaticConfig(), learner.Hyperparameters()
    if command.preset not in PRESETS:
        known = ", ".join(PRESETS)
        raise UserError(
            f"no preset '{command.preset}' of continuous actions: choose {known}, or leave "
            "--preset out"
        )
    named = command.learner or "iq-learn"
    found = PRESETS[command.preset].get(named)
    if found is None:
        known = " and ".join(PRESETS[command.preset])
        raise UserError(f"preset {command.preset} is of {known}, not of {named}: leave it out")
    if command.world and command.world not in CONTINUOUS:
        known = ", ".join(CONTINUOUS)
        raise UserError(f"preset {command.preset} is not for {command.world}: choose {known}")
    return found


def _prepared(
    command: Any,
    learner: type[Any],
    static: Any,
    runs: list[Any],
    data: Demonstrations | None,
    change: Standardisation | None,
) -> Callable[[Callbacks], Trained]:
    """Make the world, check that all fits, and return the training."""
    if learner is BehaviourCloning:
        if command.world:
            raise UserError("behaviour cloning takes no world: leave --world out")
        assert data is not None  # only soft actor-critic is without
        return lambda callbacks: learner.train_on(static, runs, [data], callbacks, CHUNK)
    datasets = [] if data is None else [data]
    if not command.world:
        check_fit(learner, static, runs, datasets, None, None, False)
        return lambda callbacks: train(
            learner, static, runs, datasets, callbacks=callbacks, chunk=CHUNK
        )
    refuse_file(command.world)
    if command.world in CONTINUOUS:
        more = _at_intersection(command.world, static, runs, data)
        check_fit(learner, static, runs, datasets, None, more["sizes"], True)
        return lambda callbacks: train(learner, static, runs, datasets, callbacks=callbacks, **more)
    given = (data.n_features, data.action_size) if data is not None else None
    make = continuous_maker(command.world, given, command.allow_code)
    if change is not None:
        make = change.maker(make)
    first = make()
    found = (sizes(first)[0], action_size(first))
    check_fit(learner, static, runs, datasets, None, found, True)
    more = {
        "sizes": found,
        "chunk": static.updates_per_round,
        "before_chunk": acting_in(make, static, runs),
    }
    return lambda callbacks: train(learner, static, runs, datasets, callbacks=callbacks, **more)


def _at_intersection(
    world: str, static: Any, runs: list[Any], data: Demonstrations | None
) -> dict[str, Any]:
    """Return what `train` needs to let runs act on the compiled core, all in one batch.

    Observations end with the time if those of the demonstrations do; without demonstrations, if the
    networks tell values of it apart.
    """
    steps = static.updates_per_round * getattr(static, "env_steps_per_update", 1)
    options = continuous_options(world)
    listed = Intersection(options).n_features
    clock = static.times > 0 if data is None else data.n_features == listed + 1
    env = intersections(options, len(runs) * SIDE_BY_SIDE, clock)
    rounds = -(-steps // SIDE_BY_SIDE)
    return {
        "sizes": (listed + clock, width(options)),
        "chunk": static.updates_per_round,
        "before_chunk": ActorVectorCollector(env, rounds, static, runs),
    }
