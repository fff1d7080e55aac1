"""Roads as Gymnasium environments and as vector environments."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from socialiq.errors import UserError
from socialiq.social.angle import check_angle, score, weights
from socialiq.types import Ending
from socialiq.worlds.highway.episodes import RoadBatch
from socialiq.worlds.highway.scene import Scene
from socialiq.worlds.highway.state import Contact
from socialiq.worlds.highway.world import world_of
from socialiq.worlds.world import Decisions, World

TERMINAL = (int(Ending.ARRIVAL), int(Ending.COLLISION), int(Ending.OTHER))


def _spaces(world: World, batch: RoadBatch, clock: bool) -> tuple[spaces.Box, gymnasium.Space[Any]]:
    low, high = (np.full(world.n_features + clock, end, np.float32) for end in (-1.0, 1.0))
    if clock:
        low[-1], high[-1] = 0.0, batch.options.decisions
    return spaces.Box(low, high, dtype=np.float32), world.action_space


class RoadEnv(gymnasium.Env):
    """Road with the Gymnasium interface.

    The scalar reward is R(α) (Eq 4.3) at the given angle. `info` has `reward_pair`
    (r_env, r_social), `signals` (every named signal, unweighted), `ending` (its name), the ego's
    `speed` in m/s, `contact` (which vehicle struck, if the ego collided), `neighbours_collided`,
    `classical` (the ego's own reward and its neighbours' mean, thesis A.1) and `off_road`. Where
    leaving the road ends an episode, its ending is `other`.

    Args:
        world: The road.
        batch: One episode of it.
        angle: Social angle α in degrees of the scalar reward R(α).
        render_mode: One of `metadata`, or None.
        clock: Whether observations end with the time, in decisions since the reset.

    Raises:
        UserError: If the angle is invalid.
    """

    def __init__(
        self, world: World, batch: RoadBatch, angle: float, render_mode: str | None, clock: bool
    ) -> None:
        self.world, self.batch = world, batch
        self.render_mode = render_mode
        self._weights = weights(check_angle(angle))
        self.observation_space, self.action_space = _spaces(world, batch, clock)
        self._clock = clock

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start the episode that highway-env starts with this seed, or continue the stream."""
        super().reset(seed=seed, options=options)
        if seed is None and not self.batch.begun.all():
            seed = int(self.np_random.integers(2**31))
        observation = self.batch.reset(None if seed is None else [seed])
        return self._with_time(observation, self.batch.time)[0], {}

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Take one decision. A timeout truncates; every other ending terminates."""
        chosen = action if self.batch.options.continuous else int(action)
        decisions = self.batch.step(np.asarray([chosen]), auto_reset=False)
        ending = int(decisions.ending[0])
        info = {
            "reward_pair": np.array([decisions.rewards.env[0], decisions.rewards.social[0]]),
            "signals": {name: float(values[0]) for name, values in decisions.signals.items()},
            "ending": Ending(ending).name.lower(),
            "speed": float(decisions.speed[0]),
            "contact": Contact(int(decisions.contact[0])).name.lower(),
        }
        if len(decisions.off_road):  # where the world reports these
            classical = decisions.classical
            info["neighbours_collided"] = int(decisions.neighbours_collided[0])
            info["classical"] = np.array([classical.env[0], classical.social[0]])
            info["off_road"] = bool(decisions.off_road[0])
        reward = float(score(self._weights, decisions.rewards)[0])
        terminated, truncated = ending in TERMINAL, ending == int(Ending.TIMEOUT)
        observation = self._with_time(decisions.observation, self.batch.time)
        return observation[0], reward, terminated, truncated, info

    def render(self) -> np.ndarray | None:
        """Return a picture of the current state, uint8 (height, width, 3)."""
        if self.render_mode != "rgb_array":
            return None
        from socialiq.worlds.highway.pictures.render import present_scene
        from socialiq.worlds.highway.pictures.sheet import picture
        from socialiq.worlds.pictures import pixels

        assert self.world.view is not None
        return pixels(picture(present_scene(self.batch), self.world.view))

    def _with_time(self, observation: np.ndarray, time: np.ndarray) -> np.ndarray:
        return np.column_stack([observation, time]) if self._clock else observation


class RoadVectorEnv(gymnasium.vector.VectorEnv):
    """Many episodes of a road with Gymnasium's vector interface, on several threads.

    `info` has the quantities of `RoadEnv` as arrays, `ending` and `contact` as the numbers
    of `types.Ending` and `Contact`. They belong to the decision, also where it was followed by a
    reset. With `AutoresetMode.SAME_STEP`, `final_obs` has the observations of the states reached.

    Args:
        world: The road.
        batch: As many episodes of it as environments.
        angle: Social angle α in degrees of the scalar reward R(α).
        autoreset_mode: Gymnasium's.
        clock: As of `RoadEnv`.

    Raises:
        UserError: If the angle is invalid.
    """

    def __init__(
        self,
        world: World,
        batch: RoadBatch,
        angle: float,
        autoreset_mode: AutoresetMode,
        clock: bool,
    ) -> None:
        self.world, self.batch = world, batch
        self.num_envs = num_envs = batch.size
        self.metadata = {"autoreset_mode": autoreset_mode}
        self.autoreset_mode = autoreset_mode
        self._weights = weights(check_angle(angle))
        self.single_observation_space, self.single_action_space = _spaces(world, batch, clock)
        self._clock = clock
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._ended = np.zeros(num_envs, bool)

    def reset(
        self, *, seed: int | list[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start episodes: row i with seed + i, or with its own seed from a list.

        Args:
            seed: One number, a list with a seed for each row, or None to continue the streams.
            options: `reset_mask`, a Boolean for each row, selects the rows.
        """
        mask = np.ones(self.num_envs, bool)
        if options and "reset_mask" in options:
            mask = np.asarray(options["reset_mask"], bool)
        if isinstance(seed, int):
            seed = [seed + row for row in range(self.num_envs)]
        if seed is None and not self.batch.begun[mask].all():
            seed = self.np_random.integers(2**31, size=self.num_envs).tolist()
        self._ended[mask] = False
        chosen = None if seed is None else np.asarray(seed)[mask]
        return self._with_time(self.batch.reset(chosen, rows=mask), self.batch.time), {}

    def _with_time(self, observation: np.ndarray, time: np.ndarray) -> np.ndarray:
        return np.column_stack([observation, time]) if self._clock else observation

    def step(
        self, actions: Any
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Take one decision in every episode, with resets by the autoreset mode."""
        same_step = self.autoreset_mode == AutoresetMode.SAME_STEP
        resetting = self._ended.copy()
        if resetting.any():
            if self.autoreset_mode == AutoresetMode.DISABLED:
                raise UserError("an episode has ended: reset it first, with options reset_mask")
            self.batch.reset(rows=resetting)
        before = self.batch.time
        decisions = self.batch.step(np.asarray(actions), auto_reset=same_step, rows=~resetting)
        terminated = np.isin(decisions.ending, TERMINAL) & ~resetting
        truncated = (decisions.ending == int(Ending.TIMEOUT)) & ~resetting
        reward = np.where(resetting, 0.0, score(self._weights, decisions.rewards))
        if not same_step:
            self._ended = terminated | truncated
        info = _masked(decisions, ~resetting)
        if same_step and (terminated | truncated).any():
            reached = self._with_time(decisions.observation, before + 1.0)
            info |= _final(reached, terminated | truncated)
        observation = self._with_time(self.batch.observation, self.batch.time)
        return observation, reward, terminated, truncated, info


def _masked(made: Decisions, mask: np.ndarray) -> dict[str, Any]:
    info: dict[str, Any] = {
        "reward_pair": np.stack(made.rewards, axis=1),
        "signals": dict(made.signals),
        "ending": made.ending,
        "speed": made.speed,
        "contact": made.contact,
        "neighbours_collided": made.neighbours_collided,
        "classical": np.stack(made.classical, axis=1),
        "off_road": made.off_road,
    }
    return info | {f"_{name}": mask.copy() for name in info}


def _final(observation: np.ndarray, ended: np.ndarray) -> dict[str, Any]:
    final = np.full(len(ended), None, object)
    for row in np.flatnonzero(ended):
        final[row] = observation[row]
    return {"final_obs": final, "_final_obs": ended}


class SceneEnv(RoadEnv):
    """Scene of highway-env with the reward pair of the intersection.

    Args:
        scene: A scene, or the name of one.
        angle: Social angle α in degrees of the scalar reward R(α).
        render_mode: "rgb_array" or None.
        clock: Whether observations end with the time, in decisions since the reset.
        options: Fields of `RoadOptions`.

    Raises:
        UserError: If the scene or an option is unknown, or the angle is invalid.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 1}  # noqa: RUF012  as in Gymnasium

    def __init__(
        self,
        scene: Scene | str,
        angle: float = 0.0,
        render_mode: str | None = None,
        clock: bool = False,
        **options: Any,
    ) -> None:
        world = world_of(scene, **options)
        super().__init__(world, world.batch(1), angle, render_mode, clock)


class SceneVectorEnv(RoadVectorEnv):
    """Many episodes of a scene with Gymnasium's vector interface, on several threads.

    Args:
        scene: A scene, or the name of one.
        num_envs: Number of episodes.
        angle: Social angle α in degrees of the scalar reward R(α).
        threads: Threads that share the episodes.
        autoreset_mode: Gymnasium's, NEXT_STEP by default.
        clock: As of `SceneEnv`.
        options: Fields of `RoadOptions`.

    Raises:
        UserError: If an option is unknown, or a number or the angle is invalid.
    """

    def __init__(
        self,
        scene: Scene | str,
        num_envs: int = 1,
        angle: float = 0.0,
        threads: int = 1,
        autoreset_mode: AutoresetMode = AutoresetMode.NEXT_STEP,
        clock: bool = False,
        **options: Any,
    ) -> None:
        world = world_of(scene, **options)
        batch = world.batch(num_envs, threads)
        super().__init__(world, batch, angle, autoreset_mode, clock)
