"""A world in SUMO as a Gymnasium environment."""

from __future__ import annotations

from typing import Any, NamedTuple

import gymnasium
import numpy as np
from gymnasium import spaces
from jaxtyping import Bool

from socialiq.errors import UserError
from socialiq.settings import parse_options
from socialiq.social.angle import check_angle, score, weights
from socialiq.types import ROWS, TERMINAL, Ending, RewardPair
from socialiq.worlds.highway.along_route import AlongRoute
from socialiq.worlds.highway.core.rewards import env_signals
from socialiq.worlds.highway.effects import SIGNALS, record_of
from socialiq.worlds.highway.ego import EgoModel
from socialiq.worlds.highway.observation import AGENT, HIGHEST, N_FEATURES, ROUTE, USERS, Line
from socialiq.worlds.highway.options import ENV_SIGNALS, FEATURES, settings_of
from socialiq.worlds.highway.scenes import ROUTE_ACTIONS
from socialiq.worlds.intersection.options import ACTIONS, IDLE
from socialiq.worlds.road_users import FIRST_CODE, ROAD_USERS
from socialiq.worlds.sumo.isolated import IsolatedEpisode, episode_of
from socialiq.worlds.sumo.network import CLASSES, VEHICLE
from socialiq.worlds.sumo.simulation import (
    EgoState,
    Episode,
    Result,
    arrival_on,
    class_of,
    gap_ahead,
)
from socialiq.worlds.sumo.traffic import EGO, Scene, SumoOptions
from socialiq.worlds.world import with_time

_UNITS = (1000.0, 1000.0, 50.0, 50.0)
"""m and m/s that rows along the route show as 1."""

_CODES = {EGO: 1.0, "vehicle": 1.0} | {
    user.sumo.name: FIRST_CODE + number for number, user in enumerate(ROAD_USERS)
}
"""Number in the place of the presence by class in SUMO."""


class State(NamedTuple):
    """Complete state of an episode: it is played again from the start."""

    seed: int
    actions: tuple[int, ...]


class SumoEnv(gymnasium.Env):
    """Junctions simulated by SUMO with the Gymnasium interface of the intersection.

    An ego drives its way through traffic of vehicles, bicycles and pedestrians. Actions and
    observation are those of `socialiq/Intersection-v1`, which has no pedestrians, or those along
    the route (`observation="route"`), which have all classes. r_env is that of the intersection,
    r_social what the ego causes (`worlds.highway.effects`), by class. The scalar reward is R(α)
    (Eq 4.3).

    `info` has `reward_pair`, `signals` (also of each class, unweighted), `ending`, `speed`, m/s,
    and `contact`.

    Args:
        net: Network that ships (crossing, row), or a file of netconvert. The option `demand` names
            a file of routes, in which an episode begins at a time that its seed draws.
        angle: Social angle α in degrees of the scalar reward.
        clock: Whether observations end with the time, in decisions since the reset.
        options: Fields of `SumoOptions`.

    Raises:
        UserError: If libsumo is missing, or an option or the network can't be used.
    """

    metadata = {"render_modes": []}  # noqa: RUF012  as in Gymnasium

    def __init__(
        self, net: str = "crossing", angle: float = 0.0, clock: bool = False, **options: Any
    ) -> None:
        self.options = parse_options("sumo", SumoOptions, {"net": net, **options})
        self.scene = Scene(self.options)
        self._weights = weights(check_angle(angle))
        self._clock = clock
        self._effects = record_of(self.options, self.options.road)["weights"][0]
        self._settings = settings_of(self.options.road).view(np.recarray)[0]
        size = self.options.road.observed_vehicles * len(FEATURES)
        limit = 1.0
        self._along: AlongRoute | None = None
        self.schema = ROWS
        if self.options.observation == "route":
            self._along = AlongRoute(EgoModel(units=_UNITS), self.options.road.max_speed)
            self.schema = ROUTE
            size = N_FEATURES
            limit = HIGHEST
        low, high = (np.full(size + clock, end, np.float32) for end in (-limit, limit))
        if clock:
            low[-1] = 0.0
            high[-1] = self.options.road.decisions
        self.observation_space = spaces.Box(low, high, dtype=np.float32)
        self.action_space = spaces.Discrete(len(ACTIONS if self._along is None else ROUTE_ACTIONS))
        self.episode: Episode | IsolatedEpisode | None = None
        self.ending = Ending.NONE

    @property
    def files(self) -> dict[str, str]:
        """SHA-256 of the network, and of the demand if there is one, which a declaration names."""
        hashes = {"net": self.scene.network.sha256}
        if self.scene.user_demand:
            hashes["demand"] = self.scene.user_demand.sha256
        return hashes

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Start the episode of a seed, or of the next one that the environment draws."""
        super().reset(seed=seed, options=options)
        chosen = int(self.np_random.integers(2**31)) if seed is None else seed
        self.episode = episode_of(self.scene, chosen)
        self.ending = Ending.NONE
        return self._observation(), {}

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Take one decision. A timeout truncates; every other ending terminates."""
        if self.episode is None or self.ending != Ending.NONE:
            raise UserError("an episode has not begun, or has ended: reset it first")
        # A change of lanes, which the schema `route` has, does what idle does.
        result = self.episode.step(int(action) if action < len(ACTIONS) else IDLE)
        self.ending, (pair, signals) = result.ending, self._pair(result)
        info = {
            "reward_pair": np.array(pair),
            "signals": signals,
            "ending": result.ending.name.lower(),
            "speed": result.speed,
            "contact": result.contact.name.lower(),
        }
        terminated = result.ending in TERMINAL
        truncated = result.ending == Ending.TIMEOUT
        return self._observation(), float(score(self._weights, pair)), terminated, truncated, info

    def _pair(self, result: Result) -> tuple[RewardPair, dict[str, float]]:
        """Return the rewards of a decision (Eq 4.1, and of effects), and every signal."""
        own = np.zeros(len(ENV_SIGNALS))
        env_signals(result.advance, True, result.speed, int(result.ending), self._settings, own)
        r_env = sum(w * s for w, s in zip(self._settings.weights, own, strict=False))
        by_class = np.array(self.options.by_class)
        delay, braking, _ = (by_class @ result.caused).tolist()
        caused = delay, braking, float((by_class * result.encounter).max())
        ends = *caused, float(result.ending == Ending.COLLISION)
        r_social = sum(w * s for w, s in zip(self._effects, ends, strict=True))
        signals: dict[str, float] = dict(
            zip((*ENV_SIGNALS, *SIGNALS), (*own.tolist(), *caused), strict=True)
        )
        for number, kind in enumerate(CLASSES):
            *columns, signals[f"waiting_{kind}"] = result.caused[number].tolist()
            columns.append(result.encounter[number])
            signals[f"collision_{kind}"] = float(result.partner == kind)
            signals |= {
                f"{name}_{kind}": float(v) for name, v in zip(SIGNALS, columns, strict=True)
            }
        return RewardPair(float(r_env), float(r_social)), signals

    @property
    def walks(self) -> bool:
        """Whether people walk or ride: a file of routes may have some, too."""
        options = self.options
        rates = [getattr(options, f"{kind}_rate") for kind in CLASSES if kind != VEHICLE.name]
        return bool(options.demand) or any(rates)

    def near(self, seconds: float) -> Bool[np.ndarray, " 1"]:
        """Return whether the ego reaches a person in its way within some seconds.

        Args:
            seconds: Time, s.
        """
        assert self.episode is not None
        ego, *bodies = self.episode.bodies
        reach = seconds * max(ego.speed, self.options.road.target_speeds[1])
        people = [body for body in bodies if class_of(body.name) != VEHICLE.name]
        return np.array([any(gap_ahead(ego, person, seconds) < reach for person in people)])

    def braked(self, actions: np.ndarray) -> np.ndarray:
        """Return the number of the action `slower` in the place of each action.

        Args:
            actions: Numbers of actions.
        """
        return np.full_like(actions, ACTIONS.index("slower"))

    def _observation(self) -> np.ndarray:
        assert self.episode is not None
        time = np.float32(len(self.episode.actions))
        observation = self.episode.observation
        if self._along is not None:
            observation = self._along_route(self._along, self.episode)
        return with_time(observation, time, self._clock)

    def _along_route(self, schema: AlongRoute, episode: Episode | IsolatedEpisode) -> np.ndarray:
        """Return the observation along the route, of all classes of road users."""
        state = episode.ego_state
        ego = episode.bodies[0]
        apart = [np.hypot(body.x - ego.x, body.y - ego.y) for body in episode.bodies]
        nearest = np.argsort(apart, kind="stable")[: USERS + 1]
        rows = np.zeros((1, USERS + 1, len(FEATURES)), np.float32)
        for row, number in zip(rows[0], nearest.tolist(), strict=False):
            body = episode.bodies[number]
            velocity = body.speed * body.along_x, body.speed * body.along_y
            row[0] = _CODES[class_of(body.name)]
            row[1:5] = np.array([body.x, body.y, *velocity]) / _UNITS
            row[5:] = body.along_x, body.along_y
        agents = np.zeros(1, AGENT)
        agents["way"] = schema.numbers(np.array([state.junction]), lambda _: self._route(state))
        agents["target_speed"] = state.target_speed
        agents["seconds_left"] = self.options.duration - len(episode.actions)
        agents["cos"] = 1.0
        return schema(rows.reshape(1, -1), agents)[0]

    def _route(self, state: EgoState) -> Line:
        """Return the route in the frame of a junction on the ego's way."""
        from socialiq.worlds.highway.ways import line_of  # imports Numba

        pieces = self.scene.network.line_of(self.scene.way)
        metres = [float(np.hypot(*np.diff(piece, axis=0).T).sum()) for piece in pieces]
        ends = np.cumsum(metres)
        last = pieces[-1]
        goal = ends[-2] + arrival_on(float(np.hypot(*np.diff(last, axis=0).T).sum()))
        frame = state.frame
        x, y = (np.concatenate(pieces) - (frame.x, frame.y)).T
        turned = np.stack(frame.turned(x, y), axis=-1)
        return line_of(turned, ends[2 * state.junction], ends[2 * state.junction + 1], goal)

    @property
    def shown_rows(self) -> np.ndarray:
        """Rows of road users as at the intersection, for rules, in one list of numbers."""
        assert self.episode is not None
        return self.episode.observation

    def save(self) -> State:
        """Return the state of the episode."""
        if self.episode is None:
            raise UserError("no episode has begun: reset the environment first")
        return State(self.episode.seed, tuple(self.episode.actions))

    def restore(self, state: State) -> np.ndarray:
        """Play an episode to a saved state, and return the observation; it goes on bit for bit."""
        observation, _ = self.reset(seed=state.seed)
        for action in state.actions:
            observation = self.step(action)[0]
        return observation
