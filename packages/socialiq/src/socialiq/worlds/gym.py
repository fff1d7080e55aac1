"""Worlds as Gymnasium environments and as vector environments; `worlds.IDS` has their ids."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from socialiq.errors import UserError
from socialiq.foreign import Later
from socialiq.social.angle import check_angle, score, weights
from socialiq.types import TERMINAL, Ending
from socialiq.worlds import catalogue, pictures, registry
from socialiq.worlds.grid_world import GridWorld
from socialiq.worlds.highway.batch import RoadBatch
from socialiq.worlds.highway.observation import HIGHEST
from socialiq.worlds.highway.options import Contact
from socialiq.worlds.highway.people import PeopleOptions
from socialiq.worlds.highway.scenes import Scene
from socialiq.worlds.highway.world import RoadWorld, SceneWorld, world_of
from socialiq.worlds.intersection.core.geometry import CROSSING
from socialiq.worlds.road_users import FIRST_CODE, ROAD_USERS
from socialiq.worlds.world import Decisions, with_time

jax: Any = Later("jax")


class GridWorldEnv(gymnasium.Env):
    """Gridworld with the Gymnasium interface; every number comes from the world's rules.

    The scalar reward is R(α) (Eq 4.3) at the given angle. `info` has `reward_pair`
    (r_env, r_social), `signals` (every named signal), `ending` (its name) and the ego's `speed`.

    The world is named, with options as for `worlds.registry.make`. With a clock observations end
    with the time. The render mode is "rgb_array" or None.

    Raises:
        UserError: If the world or an option is unknown, or the angle is invalid.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 4}  # noqa: RUF012  as in Gymnasium

    def __init__(
        self,
        world: str = "crossing7",
        angle: float = 0.0,
        render_mode: str | None = None,
        clock: bool = False,
        **options: Any,
    ) -> None:
        plain = registry.make_grid(world, **options)
        self.world: GridWorld = plain.with_clock() if clock else plain
        self.render_mode = render_mode
        self._weights = weights(check_angle(angle))
        low = np.array([feature.low for feature in self.world.observed], np.float32)
        high = low + np.array([feature.size for feature in self.world.observed], np.float32) - 1
        low[low == high] = 0.0  # Gymnasium warns of features that never change
        self.observation_space = spaces.Box(low, high, dtype=np.float32)
        self.action_space = self.world.action_space
        self._state = np.zeros(len(self.world.features), np.int32)
        self._time = 0
        self._rules: Any = None  # compiled at the first step

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Start an episode.

        Args:
            seed: Seed of the environment's generator; None: the generator goes on.
            options: Not used.

        Returns:
            The observation, and an empty `info`.
        """
        super().reset(seed=seed, options=options)
        chosen = self.np_random.choice(len(self.world.start), p=[p for _, p in self.world.start])
        self._state = np.array(self.world.start[chosen][0], np.int32)
        self._time = 0
        return self._observation(), {}

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Take one step. The horizon truncates; every other ending terminates."""
        self._rules = self._rules or jax.jit(self.world.rules)
        chance = self.np_random.choice(len(self.world.chance), p=self.world.chance)
        outcome = self._rules(self._state, int(action), int(chance))
        self._state = np.asarray(outcome.state)
        self._time += 1
        ending = Ending(int(outcome.ending))
        if ending == Ending.NONE and self._time >= self.world.horizon:
            ending = Ending.TIMEOUT
        signals = {name: float(value) for name, value in outcome.signals.items()}
        rewards = self.world.rewards(signals)
        info = {
            "reward_pair": np.array(rewards, np.float64),
            "signals": signals,
            "ending": ending.name.lower(),
            "speed": float(outcome.speed),
        }
        reward = float(score(self._weights, rewards))
        return self._observation(), reward, ending in TERMINAL, ending == Ending.TIMEOUT, info

    def _observation(self) -> np.ndarray:
        return with_time(self._state, self._time, self.world.clock).astype(np.float32)

    def render(self) -> np.ndarray | None:
        """Return a picture of the current state, uint8 (height, width, 3)."""
        if self.render_mode != "rgb_array":
            return None
        return pictures.pixels(pictures.picture(self.world, self._state.tolist()))


def _road(
    scene: RoadWorld | Scene | str, options: dict[str, Any], size: int, threads: int = 1
) -> tuple[RoadWorld, RoadBatch]:
    """Return a road as the constructors below name it, and episodes of it."""
    if not isinstance(scene, str):
        world = scene if isinstance(scene, RoadWorld) else world_of(scene, **options)
        return world, world.batch(size, threads)
    back_end = options.pop("back_end", "core")
    road = registry.make(scene, **options)
    if not isinstance(road, SceneWorld):
        raise UserError(f"{scene} is a gridworld: choose {', '.join(catalogue.ROADS)}")
    if road.agents > 1:
        raise UserError(
            f"{road.agents} agents are driven by `socialiq population` and "
            "`worlds.parallel.RoadParallelEnv`: leave agents out here"
        )
    return road, road.batch(size, threads, back_end=back_end)


def observations_of(world: RoadWorld, clock: bool) -> spaces.Box:
    """Return the space of an observation of a road.

    Args:
        world: The road.
        clock: Whether an observation ends with the time, in decisions.
    """
    limit = HIGHEST if world.options.along_route else 1.0
    walks = world.options if isinstance(world.options, PeopleOptions) else None
    if walks and not world.options.along_route:
        limit = FIRST_CODE + ROAD_USERS.index(walks.road_users[-1])
    least = -limit if world.options.along_route else -1.0
    low, high = (np.full(world.n_features + clock, end, np.float32) for end in (least, limit))
    if clock:
        low[-1] = 0.0
        most_time = np.float32(world.options.decisions)
        high[-1] = world.front_end.clock(most_time) if world.front_end else most_time
    return spaces.Box(low, high, dtype=np.float32)


def facts_of(decisions: Decisions, at: tuple[int, ...]) -> dict[str, Any]:
    """Return `info` of one decision.

    Args:
        decisions: Results of a batch.
        at: Place in these arrays: the row of an episode, and of several agents the agent's number.

    Returns:
        `reward_pair`, `signals`, `ending`, `speed` (m/s), `contact` and `neighbours_collided`;
        `classical` and `off_road` where the world reports them.
    """
    facts = {
        "reward_pair": np.array([decisions.rewards.env[at], decisions.rewards.social[at]]),
        "signals": {name: float(values[at]) for name, values in decisions.signals.items()},
        "ending": Ending(int(decisions.ending[at])).name.lower(),
        "speed": float(decisions.speed[at]),
        "contact": Contact(int(decisions.contact[at])).name.lower(),
        "neighbours_collided": int(decisions.neighbours_collided[at]),
    }
    if len(decisions.off_road):  # a recorded junction doesn't report these
        facts["classical"] = np.array([decisions.classical.env[at], decisions.classical.social[at]])
        facts["off_road"] = bool(decisions.off_road[at])
    return facts


class RoadEnv(gymnasium.Env):
    """The intersection, or a scene of highway-env, with the Gymnasium interface.

    The scalar reward is R(α) (Eq 4.3) at the given angle. `info` has `reward_pair` (r_env,
    r_social), `signals` (every named signal, unweighted), `ending` (its name), the ego's `speed` in
    m/s, `contact` (which vehicle struck, if the ego collided), `neighbours_collided`, `classical`
    (the ego's own reward and its neighbours' mean, thesis A.1) and `off_road`. Where leaving the
    road ends an episode, its ending is `other`.

    Args:
        scene: "intersection", one with crosswalks, the name of a scene, or a scene.
        angle: Social angle α in degrees of the scalar reward R(α).
        render_mode: "rgb_array" or None.
        clock: Whether observations end with the time, in decisions since the reset.
        options: Fields of the road's options, `shift` and `front_end`. Those of the intersection
            are of `Options`, with `actions` of `ContinuousOptions`; its `back_end` may be
            "highway_env".

    Raises:
        UserError: If the scene or an option is unknown, the angle is invalid, or highway-env is not
            installed.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012  as in Gymnasium

    def __init__(
        self,
        scene: RoadWorld | Scene | str = "intersection",
        angle: float = 0.0,
        render_mode: str | None = None,
        clock: bool = False,
        **options: Any,
    ) -> None:
        self.world, self.batch = _road(scene, options, 1)
        if isinstance(self.world, SceneWorld) and self.world.scene is not CROSSING:
            self.metadata = {**self.metadata, "render_fps": 1}
        self.render_mode = render_mode
        self._clock = clock
        self._weights = weights(check_angle(angle))
        self.observation_space = observations_of(self.world, clock)
        self.action_space = self.world.action_space

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Start an episode.

        Args:
            seed: Seed, with which highway-env starts the same episode; None continues the stream of
                random numbers, or draws a seed for the first episode.
            options: Not used.

        Returns:
            The observation, and an empty `info`.
        """
        super().reset(seed=seed, options=options)
        if seed is None and not self.batch.begun.all():
            seed = int(self.np_random.integers(2**31))
        observation = self.batch.reset(None if seed is None else [seed])
        return with_time(observation, self.batch.time, self._clock)[0], {}

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Take one decision. A timeout truncates; every other ending terminates."""
        chosen = action if self.world.options.continuous else int(action)
        decisions = self.batch.step(np.asarray([chosen]), auto_reset=False)
        ending = int(decisions.ending[0])
        info = facts_of(decisions, (0,))
        reward = float(score(self._weights, decisions.rewards)[0])
        observation = with_time(decisions.observation, self.batch.time, self._clock)[0]
        return observation, reward, ending in TERMINAL, ending == int(Ending.TIMEOUT), info

    @property
    def shown_rows(self) -> np.ndarray:
        """Rows of road users that the ego is shown, for rules, in one list of numbers."""
        return self.batch.shown_rows[0].copy()

    def action_masks(self) -> np.ndarray:
        """Return which actions do something now, bool (action,), as learners with masks ask."""
        return self.batch.action_mask[0]

    def render(self) -> np.ndarray | None:
        """Return a picture of the current state, uint8 (height, width, 3)."""
        if self.render_mode != "rgb_array":
            return None
        from socialiq.worlds.highway.render import present_scene
        from socialiq.worlds.highway.sheet import picture

        return pictures.pixels(picture(present_scene(self.batch), self.world.view))


class RoadVectorEnv(gymnasium.vector.VectorEnv):
    """Episodes of a road with Gymnasium's vector interface, on several threads.

    `info` has the quantities of `RoadEnv` as arrays, `ending` and `contact` as the numbers of
    `types.Ending` and `Contact`. They belong to the decision, also where it was followed by a
    reset. With `AutoresetMode.SAME_STEP`, `final_obs` has the observations of the states reached.

    Args:
        scene: As for `RoadEnv`.
        num_envs: Number of episodes side by side.
        angle: Social angle α in degrees of the scalar reward R(α).
        threads: Number of threads that share the episodes.
        autoreset_mode: When an episode that ended is reset, as in Gymnasium.
        clock: Whether observations end with the time, in decisions since the reset.
        options: Fields of the road's options, as for `RoadEnv`.

    Raises:
        UserError: If an option is unknown, or a number or the angle is invalid.
    """

    def __init__(
        self,
        scene: RoadWorld | Scene | str = "intersection",
        num_envs: int = 1,
        angle: float = 0.0,
        threads: int = 1,
        autoreset_mode: AutoresetMode = AutoresetMode.NEXT_STEP,
        clock: bool = False,
        **options: Any,
    ) -> None:
        self.world, self.batch = _road(scene, options, num_envs, threads)
        self.num_envs = num_envs
        self._clock = clock
        self.metadata = {"autoreset_mode": autoreset_mode}
        self.autoreset_mode = autoreset_mode
        self._weights = weights(check_angle(angle))
        self.single_observation_space = observations_of(self.world, clock)
        self.single_action_space: gymnasium.Space[Any] = self.world.action_space
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._ended = np.zeros(self.num_envs, bool)

    def reset(
        self, *, seed: int | list[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start episodes.

        Args:
            seed: One number, with which row i gets seed + i; or a list with the seed of each row.
                None continues the rows' streams, or draws seeds if a row has none yet.
            options: With `reset_mask`, a Boolean for each row, only the rows where it is True
                start; without it all do.

        Returns:
            The observations of all rows, and an empty `info`.
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
        return with_time(self.batch.reset(chosen, rows=mask), self.batch.time, self._clock), {}

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
        ended = terminated | truncated
        info: dict[str, Any] = {
            "reward_pair": np.stack(decisions.rewards, axis=1),
            "signals": dict(decisions.signals),
            "ending": decisions.ending,
            "speed": decisions.speed,
            "contact": decisions.contact,
            "neighbours_collided": decisions.neighbours_collided,
            "classical": np.stack(decisions.classical, axis=1),
            "off_road": decisions.off_road,
        }
        info |= {f"_{name}": ~resetting for name in info}
        if not same_step:
            self._ended = ended
        elif ended.any():
            reached = with_time(decisions.observation, before + 1.0, self._clock)
            final = np.full(len(ended), None, object)
            for row in np.flatnonzero(ended):
                final[row] = reached[row]
            info |= {"final_obs": final, "_final_obs": ended}
        observation = with_time(self.batch.observation, self.batch.time, self._clock)
        return observation, reward, terminated, truncated, info


def learning_env(
    world: RoadWorld, count: int, clock: bool = False, threads: int = 1
) -> RoadVectorEnv:
    """Return episodes of a road to learn in: one that ends is reset in the same step.

    Args:
        world: The road.
        count: Number of episodes side by side.
        clock: Whether observations end with the time, in decisions.
        threads: Number of threads that share the episodes.
    """
    mode = AutoresetMode.SAME_STEP
    return RoadVectorEnv(world, count, threads=threads, autoreset_mode=mode, clock=clock)
