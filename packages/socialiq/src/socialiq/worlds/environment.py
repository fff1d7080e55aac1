"""User-provided environments, made by name. Their code runs only where the caller allows it."""

import importlib
import importlib.util
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.utils import RecordConstructorArgs

from socialiq.errors import UserError
from socialiq.foreign import FAILURES, failure, imported, one_line
from socialiq.storage import kind_of
from socialiq.types import ACTION_BOUNDS
from socialiq.worlds import (
    ENVIRONMENT_PATTERN,
    IDS,
    RECORDED_JUNCTION,
    SCENE_IDS,
    SUMO_IDS,
    SUMO_NET,
    WORLD_FILE,
    register,
    wrapper,
)
from socialiq.worlds.catalogue import ROADS
from socialiq.worlds.grammar import parse

_HIGHWAY = "highway_env"
_BUILT_IN = IDS | SCENE_IDS | SUMO_IDS


def is_environment(text: str) -> bool:
    """Whether a text denotes a scene, a world in SUMO, or an environment that is not built in."""
    written = parse(text)
    is_id = re.fullmatch(ENVIRONMENT_PATTERN, written.name) is not None
    return written.name in SCENE_IDS or written.in_sumo or is_id


def make_environment(
    name: str,
    options: Mapping[str, Any] | None = None,
    *,
    allow_code: bool = False,
    needs_pair: bool = False,
    continuous: bool = False,
) -> gymnasium.Env[Any, Any]:
    """Make an environment that policies can drive in, with flat observations.

    Actions are discrete, or where that is allowed float32 vectors in [-1, 1], which are scaled to
    the bounds of the environment's action space.

    Args:
        name: A built-in world; a file of `socialiq data world`; a network of SUMO; a Gymnasium id;
            MODULE:ID, an id that the module registers; or MODULE:FUNCTION, a function (or class) of
            the module that returns an environment. MODULE is a name that Python can import, or the
            path of a file that ends in .py. Options may follow, as in `worlds.grammar`.
        options: Keyword arguments of the environment or of the function.
        allow_code: Whether a module may be imported. Importing runs its author's code with the
            rights of the user.
        needs_pair: Whether every step must have a reward pair; else the scalar reward is r_env
            where there is none.
        continuous: Whether actions may be arrays (`spaces.Box`) too.

    Raises:
        UserError: If the name is unknown, its code may not run or fails, or its actions or
            observations are not supported.
    """
    name, chosen = parse(name, options)
    env = _made(name, chosen, allow_code)
    if not isinstance(env, gymnasium.Env):
        raise UserError(f"{one_line(name)} made {type(env).__name__}, not a gymnasium.Env")
    wrapper.check_spaces(env, continuous)
    if needs_pair and ":" not in name and type(env.unwrapped).__module__.startswith(_HIGHWAY):
        raise UserError(
            f"{name} of highway-env gives no reward pair: choose {', '.join(ROADS[:-1])}, its "
            "roads with one, or a function of a module that wraps it in a RewardPairWrapper"
        )
    guarded: gymnasium.Env[Any, Any] = _Guarded(env, one_line(name))
    guarded = wrapper.RewardPairWrapper(guarded) if needs_pair else guarded
    return wrapper.UnitActions(guarded) if isinstance(env.action_space, spaces.Box) else guarded


def sizes(env: gymnasium.Env[Any, Any]) -> tuple[int, int]:
    """Return the length of an observation and the number of actions, 0 if these are arrays."""
    space = env.observation_space
    actions = env.action_space
    assert isinstance(space, spaces.Box)
    return int(space.shape[0]), int(actions.n) if isinstance(actions, spaces.Discrete) else 0


def action_size(env: gymnasium.Env[Any, Any]) -> int:
    """Return the length of an action of a made environment; 0 if actions are discrete."""
    actions = env.action_space
    return int(actions.shape[0]) if isinstance(actions, spaces.Box) else 0


def action_bounds(env: gymnasium.Env[Any, Any]) -> dict[str, Any]:
    """Return the bounds of a made environment's actions, in its own units, as JSON.

    The dictionary is empty if actions are discrete.
    """
    if not isinstance(env, wrapper.UnitActions):
        return {}
    ends = {"low": env.bounds.low, "high": env.bounds.high}
    return {ACTION_BOUNDS: {name: end.astype(np.float64).tolist() for name, end in ends.items()}}


def environment_maker(
    name: str,
    demonstrated: tuple[int, int] | None,
    allow_code: bool,
    continuous: bool = False,
    options: Mapping[str, Any] | None = None,
    needs_pair: bool = False,
) -> Callable[[], gymnasium.Env[Any, Any]]:
    """Return a function that makes an environment to learn in, and checks that its data fit.

    Args:
        name: Name of the environment, as for `make_environment`.
        demonstrated: Number of features of the demonstrations, and of actions, or if these are
            continuous their length; None without demonstrations.
        allow_code: Whether a module may be imported.
        continuous: Whether the learner takes continuous actions, and only these.
        options: Keyword arguments of the environment.
        needs_pair: Whether every step must have a reward pair, as `make_environment`.

    Returns:
        A function without arguments. It raises a `UserError` if the environment can't be made, has
        discrete actions for a learner of continuous ones, or differs from the demonstrations.
    """

    def make() -> gymnasium.Env[Any, Any]:
        how = {"allow_code": allow_code, "continuous": continuous, "needs_pair": needs_pair}
        env = make_environment(name, options, **how)
        actual = (sizes(env)[0], action_size(env)) if continuous else sizes(env)
        if continuous and not actual[1]:
            raise UserError(f"{one_line(name)} has discrete actions: use a learner of these")
        if demonstrated is not None and actual != demonstrated:
            actions = "actions of {} numbers" if continuous else "{} actions"
            raise UserError(
                f"the demonstrations have {demonstrated[0]} features and "
                f"{actions.format(demonstrated[1])}, the world has {actual[0]} and {actual[1]}: "
                "they belong to another world"
            )
        return env

    return make


def paired(env: gymnasium.Env[Any, Any]) -> wrapper.RewardPairWrapper | None:
    """Return the `RewardPairWrapper` with a reward function around an environment, or None."""
    while isinstance(env, gymnasium.Wrapper):
        if isinstance(env, wrapper.RewardPairWrapper) and env.pair is not None:
            return env
        env = env.env
    return None


def _made(name: str, options: dict[str, Any], allow_code: bool) -> Any:
    if kind_of(Path(name)) == WORLD_FILE:
        register()
        return gymnasium.make(RECORDED_JUNCTION, file=name, **options)
    if name.endswith(SUMO_NET):
        register()
        return gymnasium.make(SUMO_IDS["sumo"], net=name, **options)
    module, _, attribute = name.rpartition(":")
    if module and not allow_code:
        raise UserError(
            f"{one_line(name)} would run its author's code with your rights: allow that with "
            "--allow-code, or allow_code=True in Python"
        )
    try:
        function = getattr(imported(module), attribute, None) if module else None
        if callable(function):
            return function(**options)
        register()
        if attribute not in gymnasium.registry and importlib.util.find_spec(_HIGHWAY):
            importlib.import_module(_HIGHWAY)  # it registers its ids
        return gymnasium.make(attribute if module else _BUILT_IN.get(name, name), **options)
    except UserError:
        raise
    except gymnasium.error.Error as error:
        # Gymnasium raises the base class of these errors for a malformed id.
        is_unknown = isinstance(error, gymnasium.error.UnregisteredEnv)
        if not (is_unknown or type(error) is gymnasium.error.Error):
            raise failure(one_line(name), error) from error
        where = "unknown world"
        if module:
            where = f"{one_line(module)} has no function and registers no"
        raise UserError(
            f"{where} '{one_line(attribute)}': choose one of {', '.join(_BUILT_IN)}, a registered "
            "Gymnasium id, MODULE:ID or MODULE:FUNCTION"
        ) from error
    except FAILURES as error:
        raise failure(one_line(name), error) from error


class _Guarded(gymnasium.Wrapper, RecordConstructorArgs):
    """Flatten observations, and report failures of the environment's code as a `UserError`."""

    def __init__(self, env: gymnasium.Env[Any, Any], name: str) -> None:
        RecordConstructorArgs.__init__(self, name=name)
        gymnasium.Wrapper.__init__(self, env)
        self.observation_space = wrapper.flat_space(env.observation_space)
        self._name = name

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Start an episode.

        Args:
            seed: Seed of the environment; None: the environment goes on with its generator.
            options: Options of the environment's own reset.

        Returns:
            The observation, flat float32, and the environment's `info`.

        Raises:
            UserError: If the environment's code fails, or the observation is not finite or has
                another shape than its space.
        """
        observation, info = wrapper.called(self._name, self.env.reset, seed=seed, options=options)
        return self._flat(observation), info

    def step(self, action: Any) -> Any:
        """Take one step."""
        after, *results = wrapper.called(self._name, self.env.step, action)
        return (self._flat(after), *results)

    def _flat(self, observation: Any) -> np.ndarray:
        try:
            observed = wrapper.flat(self.env.observation_space, observation)
        except (KeyError, TypeError, ValueError) as error:
            raise UserError(
                f"{self._name} gave an observation that is no array of numbers: correct it"
            ) from error
        shape = self.observation_space.shape
        if observed.shape != shape or not np.isfinite(observed).all():
            fault = "NaN or infinity" if observed.shape == shape else f"shape {observed.shape}"
            raise UserError(
                f"{self._name} gave an observation of {fault}: its space has {shape}, finite"
            )
        return observed
