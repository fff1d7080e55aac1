"""An environment beside the same episode without its ego, which says what the ego causes."""

from typing import Any

import gymnasium
import numpy as np

from socialiq.errors import UserError
from socialiq.worlds.wrapper import called

WITHOUT = "without_ego"
"""Method of an environment, after a reset: the environment of the same episode without the ego."""
OTHERS = "others"
"""Entry of `info`: progress of the others in a step, in any unit."""


class BesideWithoutEgo(gymnasium.Wrapper):
    """Environment with the progress that others lose by the ego, `info["signals"]["delay"]`.

    Each step is taken in the environment without the ego too, until the driven episode ends. What
    follows is not known, because the environment ends there.

    Args:
        env: Environment whose `unwrapped` has `without_ego`, and whose `info` has `others`.

    Raises:
        UserError: If it has not. In a step: if `others` is no finite number, or its code fails.
    """

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        super().__init__(env)
        if not callable(getattr(env.unwrapped, WITHOUT, None)):
            raise UserError(
                "effects compare with the same episode without the ego, which this environment "
                f"does not give: add a method {WITHOUT} (docs/environments.md), or see r_social of "
                "`socialiq evaluate`"
            )
        self._alone: Any = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Start an episode with and without the ego.

        Args:
            seed: Seed of the environment; None: the environment goes on with its generator.
            options: Options of the environment's own reset.
        """
        result = self.env.reset(seed=seed, options=options)
        self._alone = called(WITHOUT, getattr(self.env.unwrapped, WITHOUT))
        return result

    def step(self, action: Any) -> Any:
        """Take one step with and without the ego."""
        *result, info = self.env.step(action)
        progress = 0.0  # of an episode that has ended without the ego
        if self._alone is not None:
            _, _, terminated, truncated, alone = called(WITHOUT, self._alone.step, action)
            progress = _progress(alone)
            self._alone = None if terminated or truncated else self._alone
        return *result, {**info, "signals": {"delay": progress - _progress(info)}}


def _progress(info: Any) -> float:
    value = info.get(OTHERS)
    if not isinstance(value, int | float | np.number) or not np.isfinite(value):
        raise UserError(f"info['{OTHERS}'] must be the progress of others in the step: a number")
    return float(value)
