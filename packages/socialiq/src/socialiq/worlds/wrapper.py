"""Wrappers of Gymnasium environments: reward pairs, kinds of actions, absorbing states."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, get_args

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.utils import RecordConstructorArgs

from socialiq.errors import UserError
from socialiq.foreign import FAILURES, failure, one_line
from socialiq.social.angle import check_angle, score, weights
from socialiq.types import Ending, RewardPair

FlatSpace = spaces.Box | spaces.Discrete | spaces.MultiBinary | spaces.MultiDiscrete | spaces.Dict
"""Kinds of observations that become one vector of numbers (`flat`)."""

MOST_ONE_HOT = 1_000_000
"""Largest number of features that whole numbers become."""


class Transition(NamedTuple):
    """Step of an environment: the argument of a `RewardPairWrapper`'s functions."""

    observation: Any  # before the step, as the environment gives it, not flattened
    action: Any  # the action taken: a number, or an array in the environment's own units
    next_observation: Any  # after the step
    reward: Any  # the environment's reward
    terminated: bool  # whether a terminal state was reached
    truncated: bool  # whether a clock cut the episode
    info: Mapping[str, Any]  # the environment's `info`
    # the wrapped environment; `env.unwrapped` has its state after the step
    env: gymnasium.Env[Any, Any]


class RewardPairWrapper(gymnasium.Wrapper, RecordConstructorArgs):
    """Environment with a reward pair, for collection, training, evaluation and audits.

    `info["reward_pair"]` of every step is (r_env, r_social), and the scalar reward is R(α) of it
    (Eq 4.3). Observations come flat, as float32.

    Args:
        env: Environment with discrete actions, or arrays within bounds, and observations of a kind
            that `flat` takes.
        pair: Function from a transition to (r_env, r_social). Without it the environment has to
            give `info["reward_pair"]` itself, or a vector of both as its reward.
        ending: Function from a transition that reached a terminal state to the kind of ending, an
            `Ending` or its name: arrival, collision or other. Without it `info["ending"]` is what
            the environment reports; if it reports no ending the kind is other. An episode cut by a
            time limit is truncated and counts as a timeout, whatever this function returns.
        angle: Social angle α in degrees of the scalar reward R(α).

    Raises:
        UserError: If actions or observations have another kind, or the angle is invalid. In a step:
            if there is no pair of finite numbers, the kind of ending is unknown, or one of the
            functions fails.
    """

    def __init__(
        self,
        env: gymnasium.Env[Any, Any],
        pair: Callable[[Transition], Any] | None = None,
        ending: Callable[[Transition], Ending | str] | None = None,
        angle: float = 0.0,
    ) -> None:
        check_spaces(env, continuous=True)
        RecordConstructorArgs.__init__(self, pair=pair, ending=ending, angle=angle)
        gymnasium.Wrapper.__init__(self, env)
        self.observation_space = flat_space(env.observation_space)
        self.pair = pair
        self.ending = ending
        self._weights = weights(check_angle(angle))
        self._observed: Any = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Start an episode.

        Args:
            seed: Seed of the environment; None: the environment goes on with its generator.
            options: Options of the environment's own reset.

        Returns:
            The observation, flat float32, and the environment's `info`.
        """
        self._observed, info = self.env.reset(seed=seed, options=options)
        return flat(self.env.observation_space, self._observed), info

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Take one step and add its reward pair."""
        after, raw, terminated, truncated, reported = self.env.step(action)
        reward: Any = raw  # a number, or a vector
        transition = Transition(
            self._observed,
            int(action) if isinstance(self.action_space, spaces.Discrete) else action,
            after,
            reward if np.ndim(reward) else float(reward),
            bool(terminated),
            bool(truncated),
            reported,
            self.env,
        )
        self._observed = after
        if self.pair is not None:
            pair = called("the function of the reward pair", self.pair, transition)
            pair = RewardPair.of(pair, "the reward pair")
        elif "reward_pair" in reported or np.ndim(reward):
            pair = RewardPair.of_step(transition.reward, reported)
        else:
            raise UserError(
                "the environment gives no reward pair: put (r_env, r_social) into "
                'info["reward_pair"], or wrap it in a RewardPairWrapper with a function; without a '
                "pair only angle 0 has a meaning"
            )
        info = {**reported, "reward_pair": np.array(pair)}
        if self.ending is not None and transition.terminated:
            kind = called("the function of endings", self.ending, transition)
            info["ending"] = kind.name.lower() if isinstance(kind, Ending) else str(kind)
        Ending.of_step(transition.terminated, transition.truncated, info)
        scalar = float(score(self._weights, pair))
        flattened = flat(self.env.observation_space, after)
        return flattened, scalar, transition.terminated, transition.truncated, info


def called(what: str, function: Callable[..., Any], *arguments: Any, **keywords: Any) -> Any:
    """Call code of a user, and report its failure as a `UserError`.

    Args:
        what: Name of the code, for the message.
        function: Function to call.
        *arguments: Its positional arguments.
        **keywords: Its keyword arguments.

    Returns:
        The function's result, unchanged.

    Raises:
        UserError: If the function fails.
    """
    try:
        return function(*arguments, **keywords)
    except UserError:
        raise
    except FAILURES as error:
        raise failure(what, error) from error


def check_spaces(env: gymnasium.Env[Any, Any], continuous: bool = False) -> None:
    """Refuse an environment that policies cannot drive in.

    Args:
        env: Environment to check.
        continuous: Whether arrays are allowed as actions too.

    Raises:
        UserError: If it is no environment; if its actions are not discrete from 0, nor, where these
            are allowed, arrays with finite bounds; or if its observations are not arrays.
    """
    if not isinstance(env, gymnasium.Env):
        raise UserError(f"{type(env).__name__} is no gymnasium.Env: make it by make_environment")
    actions = env.action_space
    observations = env.observation_space
    if continuous and isinstance(actions, spaces.Box):
        if len(actions.shape) != 1 or not actions.shape[0] or actions.dtype.kind != "f":
            raise UserError(
                f"actions are a Box of {actions.dtype} of shape {actions.shape}: wrap the "
                "environment so that they are one vector of floats"
            )
        is_finite = np.isfinite([actions.low, actions.high]).all()
        if not (is_finite and (actions.low < actions.high).all()):
            raise UserError(
                "the Box of actions has no finite bounds, the lower below the upper one: wrap the "
                "environment so that it has"
            )
    elif continuous and not isinstance(actions, spaces.Discrete):
        raise UserError(
            f"actions of kind {type(actions).__name__} are not supported: wrap the environment so "
            "that they are Discrete or a Box"
        )
    elif not isinstance(actions, spaces.Discrete):
        raise UserError(
            f"only discrete actions are supported, not {type(actions).__name__}: wrap the "
            "environment so that it has a few actions with numbers"
        )
    elif actions.start != 0:
        raise UserError(f"actions must be numbered from 0, not {actions.start}: wrap the actions")
    flat_space(observations)


class UnitActions(gymnasium.ActionWrapper, RecordConstructorArgs):
    """Environment whose actions are float32 vectors in [-1, 1], the ends being its own bounds.

    Its own space, `bounds`, is a `Box` within finite bounds. A step refuses other actions.
    """

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        RecordConstructorArgs.__init__(self)
        gymnasium.ActionWrapper.__init__(self, env)
        assert isinstance(env.action_space, spaces.Box)  # of others this is no wrapper
        self.bounds = env.action_space
        self.action_space = spaces.Box(-1.0, 1.0, env.action_space.shape, np.float32)

    def action(self, action: Any) -> np.ndarray:
        """Return an action in the environment's own units."""
        values = np.asarray(action, np.float64)
        if values.shape != self.bounds.shape or not np.isfinite(values).all():
            text = one_line(str(values.tolist()), 60)
            raise UserError(
                f"action {text} is not {self.bounds.shape[0]} finite numbers: check the policy"
            )
        if (np.abs(values) > 1.0).any():
            raise UserError(f"action {one_line(str(values.tolist()), 60)} is outside [-1, 1]")
        low, high = (end.astype(np.float64) for end in (self.bounds.low, self.bounds.high))
        scaled = low + (values + 1.0) / 2.0 * (high - low)
        return np.clip(scaled, low, high).astype(self.bounds.dtype)


def flat_space(space: gymnasium.Space[Any]) -> spaces.Box:
    """Return the space of flat observations, float32.

    Raises:
        UserError: If the space is of a kind that `flat` does not take, or has too many numbers.
    """
    if not isinstance(space, FlatSpace):
        kinds = ", ".join(kind.__name__ for kind in get_args(FlatSpace))
        raise UserError(
            f"only observations of kind {kinds} are supported, not {type(space).__name__}: wrap "
            "the environment in gymnasium.wrappers.FlattenObservation"
        )
    if isinstance(space, spaces.Dict):
        parts = list(map(flat_space, space.spaces.values()))
        low, high = (
            np.concatenate([getattr(part, end) for part in parts]) for end in ("low", "high")
        )
        return spaces.Box(low, high, dtype=np.float32)
    if not isinstance(space, spaces.Box):
        size = spaces.flatdim(space)
        if size > MOST_ONE_HOT:
            raise UserError(
                f"observations are {size:,} numbers as one-hot vectors: wrap the environment so "
                f"that they are at most {MOST_ONE_HOT:,}"
            )
        return spaces.Box(0.0, 1.0, (size,), np.float32)
    with np.errstate(over="ignore"):  # a bound beyond float32 is no bound
        return spaces.Box(flat(space, space.low), flat(space, space.high), dtype=np.float32)


def flat(space: gymnasium.Space[Any], observation: Any) -> np.ndarray:
    """Return an observation as one float32 vector, as `flat_rows`; a Dict's parts side by side."""
    if isinstance(space, spaces.Dict):
        parts = space.spaces.items()
        return np.concatenate([flat(part, observation[name]) for name, part in parts])
    return flat_rows(space, np.asarray(observation)[None])[0]


def flat_rows(space: gymnasium.Space[Any], observations: np.ndarray) -> np.ndarray:
    """Return observations as `gymnasium.spaces.flatten` has them: whole numbers as one-hot vectors.

    Args:
        space: Space of one observation, of a kind in `FlatSpace`, but no Dict.
        observations: Observations of that space, (row, ...).

    Returns:
        float32 (row, feature).

    Raises:
        ValueError: If a whole number is none of the space.
    """
    rows = np.reshape(observations, (len(observations), -1))
    if isinstance(space, spaces.Box | spaces.MultiBinary):
        with np.errstate(over="ignore"):  # too large a number is refused as infinity
            return rows.astype(np.float32)
    assert isinstance(space, spaces.Discrete | spaces.MultiDiscrete)
    several = isinstance(space, spaces.MultiDiscrete)
    counts = np.ravel(space.nvec if several else space.n).astype(np.int64)
    places = rows.astype(np.int64) - np.ravel(space.start)
    if places.shape[1] != len(counts) or (rows.dtype.kind not in "iu" and rows.size):
        raise ValueError("other numbers than whole ones")
    if ((places < 0) | (places >= counts)).any():
        raise ValueError("a whole number that the space does not have")
    vectors = np.zeros((len(rows), int(counts.sum())), np.float32)
    vectors[np.arange(len(rows))[:, None], np.cumsum(counts) - counts + places] = 1.0
    return vectors


class AbsorbingStates(gymnasium.Wrapper, RecordConstructorArgs):
    """Environment in which a terminal state is followed by one that is never left.

    Observations are flat, float32, and one longer. The last number is 1 in the absorbing state,
    where all numbers before it are 0; elsewhere it is 0. A step that would terminate leads to this
    state. `stay` steps in it follow, with reward 0 whatever the action, then the episode is
    truncated; r_env and r_social of these steps are 0. Time limits stay as they are. A learner that
    bootstraps through such steps learns the value of the absorbing state, for demonstrations and
    for its own experience alike.

    Raises:
        UserError: If `stay` is below 1, or observations have another kind.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], stay: int = 1) -> None:
        if stay < 1:
            raise UserError(f"stay must be at least 1, got {stay}")
        RecordConstructorArgs.__init__(self, stay=stay)
        gymnasium.Wrapper.__init__(self, env)
        inner = flat_space(env.observation_space)
        low = np.minimum(inner.low, 0.0)
        high = np.maximum(inner.high, 0.0)
        low = np.append(low, np.float32(0))
        high = np.append(high, np.float32(1))
        self.observation_space = spaces.Box(low, high, dtype=np.float32)
        self.stay = stay
        self._left: int | None = None  # steps left in the absorbing state; None outside it
        self._absorbed = np.zeros_like(low)
        self._absorbed[-1] = 1.0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Start an episode.

        Args:
            seed: Seed of the environment; None: the environment goes on with its generator.
            options: Options of the environment's own reset.

        Returns:
            The observation with a last number of 0, and the environment's `info`.
        """
        self._left = None
        observation, info = self.env.reset(seed=seed, options=options)
        return np.append(flat(self.env.observation_space, observation), np.float32(0.0)), info

    def step(self, action: Any) -> tuple[np.ndarray, Any, bool, bool, dict[str, Any]]:
        """Take one step, or stay in the absorbing state."""
        if self._left is not None:
            self._left -= 1
            info = {"reward_pair": np.zeros(2)}
            return self._absorbed.copy(), 0.0, False, self._left == 0, info
        observation, reward, terminated, truncated, info = self.env.step(action)
        if terminated:
            self._left = self.stay
            return self._absorbed.copy(), reward, False, False, info
        after = np.append(flat(self.env.observation_space, observation), np.float32(0.0))
        return after, reward, terminated, truncated, info
