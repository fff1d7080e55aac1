"""Reward pairs for any Gymnasium environment with discrete actions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from gymnasium import spaces

from socialiq.errors import UserError
from socialiq.foreign import FAILURES, failure
from socialiq.social.angle import check_angle, score, weights
from socialiq.types import Ending, RewardPair


class Transition(NamedTuple):
    """Step of an environment: the argument of a `RewardPairWrapper`'s functions.

    Attributes:
        observation: Before the step, as the environment gives it, not flattened.
        action: The action taken.
        next_observation: After the step.
        reward: The environment's scalar reward.
        terminated: Whether a terminal state was reached.
        truncated: Whether a clock cut the episode.
        info: The environment's `info`.
        env: The wrapped environment; `env.unwrapped` has its state after the step.
    """

    observation: Any
    action: int
    next_observation: Any
    reward: float
    terminated: bool
    truncated: bool
    info: Mapping[str, Any]
    env: gymnasium.Env[Any, Any]


class RewardPairWrapper(gymnasium.Wrapper):
    """Environment with a reward pair, for collection, training, evaluation and audits.

    `info["reward_pair"]` of every step is (r_env, r_social), and the scalar reward is R(α) of it
    (Eq 4.3). Observations come flat, as float32.

    Args:
        env: With discrete actions and observations that are arrays (`spaces.Box`).
        pair: From a transition to (r_env, r_social). Without it the environment has to give
            `info["reward_pair"]` itself.
        ending: From a transition that reached a terminal state to the kind of ending, an `Ending`
            or its name: arrival, collision or other. Without it `info["ending"]` is what the
            environment reports; if it reports nothing the kind is other. An episode cut by a time
            limit is truncated and counts as a timeout, whatever this function returns.
        angle: Social angle α in degrees of the scalar reward R(α).

    Raises:
        UserError: If actions or observations are of another kind, or the angle is invalid. In a
            step: if there is no pair of finite numbers, the kind of ending is unknown, or one of
            the functions fails.
    """

    def __init__(
        self,
        env: gymnasium.Env[Any, Any],
        pair: Callable[[Transition], Any] | None = None,
        ending: Callable[[Transition], Ending | str] | None = None,
        angle: float = 0.0,
    ) -> None:
        check_spaces(env)
        super().__init__(env)
        self.observation_space = flat_space(env.observation_space)
        self.pair, self.ending = pair, ending
        self._weights = weights(check_angle(angle))
        self._seen: Any = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start an episode."""
        self._seen, info = self.env.reset(seed=seed, options=options)
        return flat(self._seen), info

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Take one step and add its reward pair."""
        after, reward, terminated, truncated, told = self.env.step(action)
        moment = Transition(
            self._seen,
            int(action),
            after,
            float(reward),
            bool(terminated),
            bool(truncated),
            told,
            self.env,
        )
        self._seen = after
        pair = self._pair_of(moment)
        info = {**told, "reward_pair": np.array(pair)}
        if self.ending is not None and moment.terminated:
            info["ending"] = _name(_called(self.ending, moment, "the function of endings"))
        Ending.of_step(moment.terminated, moment.truncated, info)
        scalar = float(score(self._weights, pair))
        return flat(after), scalar, moment.terminated, moment.truncated, info

    def _pair_of(self, moment: Transition) -> RewardPair:
        if self.pair is not None:
            found = _called(self.pair, moment, "the function of the reward pair")
            return RewardPair.of(found, "the reward pair")
        if "reward_pair" not in moment.info:
            raise UserError(
                "the environment gives no reward pair: put (r_env, r_social) into "
                'info["reward_pair"], or wrap it in a RewardPairWrapper with a function'
            )
        return RewardPair.of_step(moment.reward, moment.info)


def check_spaces(env: gymnasium.Env[Any, Any]) -> None:
    """Raise an error for an environment that policies cannot drive in.

    Raises:
        UserError: If its actions are not discrete from 0, or its observations are not arrays.
    """
    actions, seen = env.action_space, env.observation_space
    if not isinstance(actions, spaces.Discrete):
        raise UserError(
            f"only discrete actions are supported, not {type(actions).__name__}: wrap the "
            "environment so that it has a few actions with numbers"
        )
    if actions.start != 0:
        raise UserError(f"actions must be numbered from 0, not {actions.start}: wrap the actions")
    if not isinstance(seen, spaces.Box):
        raise UserError(
            f"only observations of kind Box are supported, not {type(seen).__name__}: wrap the "
            "environment in gymnasium.wrappers.FlattenObservation"
        )


def flat_space(space: gymnasium.Space[Any]) -> spaces.Box:
    """Return the space of flattened observations, float32.

    Raises:
        UserError: If it is not a `Box`.
    """
    if not isinstance(space, spaces.Box):
        raise UserError("only observations of kind Box can be flattened")
    with np.errstate(over="ignore"):  # a bound beyond float32 is no bound
        return spaces.Box(flat(space.low), flat(space.high), dtype=np.float32)


def flat(observation: Any) -> np.ndarray:
    """Return an observation flattened to one float32 vector."""
    return np.ravel(np.asarray(observation, np.float32))


def _called(function: Callable[[Transition], Any], moment: Transition, what: str) -> Any:
    try:
        return function(moment)
    except UserError:
        raise
    except FAILURES as error:
        raise failure(what, error) from error


def _name(kind: Ending | str) -> str:
    return kind.name.lower() if isinstance(kind, Ending) else str(kind)
