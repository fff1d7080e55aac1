"""Roads with several agents as PettingZoo environments; needs the extra `pettingzoo`."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces

from socialiq.errors import UserError
from socialiq.foreign import optional
from socialiq.social.angle import check_angle, score, weights
from socialiq.types import TERMINAL, Ending
from socialiq.worlds.gym import facts_of, observations_of
from socialiq.worlds.registry import make_fleet
from socialiq.worlds.world import Decisions, with_time

ParallelEnv: Any = optional("pettingzoo", "pettingzoo", "the parallel environment").ParallelEnv


class RoadParallelEnv(ParallelEnv):
    """A road with several agents, `agent_0` and so on, with PettingZoo's interface.

    An agent that arrives or crashes is terminated, one that runs out of time is truncated; with
    `ends="joint"` all leave together. An agent's reward is R(α) (Eq 4.3) at its angle, and `infos`
    have what `worlds.gym.RoadEnv` has in `info`, each agent's own.

    Args:
        name: "intersection", or the name of a scene.
        agents: Number of agents.
        angle: Social angle α in degrees of all agents, or of each.
        clock: Whether observations end with the time, in decisions since the reset.
        options: Further options of `worlds.registry.make_fleet`.

    Raises:
        UserError: If the road or an option is unknown, a number or an angle is invalid, or
            PettingZoo is not installed.
    """

    metadata = {"name": "socialiq_v0", "render_modes": [], "is_parallelizable": True}  # noqa: RUF012  as in PettingZoo
    render_mode = None

    def __init__(
        self,
        name: str = "intersection",
        agents: int = 2,
        angle: float | Sequence[float] = 0.0,
        clock: bool = False,
        **options: Any,
    ) -> None:
        self.world = make_fleet(name, agents, **options)
        self.batch = self.world.batch(1)
        self._clock = clock
        self.possible_agents = [f"agent_{number}" for number in range(agents)]
        self.agents: list[str] = []
        angles = [angle] * agents if isinstance(angle, int | float) else list(angle)
        if len(angles) != agents:
            raise UserError(f"angle must be one number, or {agents} of them, got {len(angles)}")
        self._weights = [weights(check_angle(degrees)) for degrees in angles]
        self._numbers = {agent: number for number, agent in enumerate(self.possible_agents)}
        pairs = {
            agent: (observations_of(self.world, clock), self.world.action_space)
            for agent in self.possible_agents
        }
        self.observation_spaces = {agent: space for agent, (space, _) in pairs.items()}
        self.action_spaces = {agent: space for agent, (_, space) in pairs.items()}
        self._draws = np.random.default_rng()

    def observation_space(self, agent: str) -> spaces.Box:
        """Return the space of an agent's observations."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Any:
        """Return the space of an agent's actions."""
        return self.action_spaces[agent]

    def reset(
        self,
        seed: int | None = None,
        options: dict[str, Any] | None = None,  # noqa: ARG002  part of the interface
    ) -> tuple[dict[str, np.ndarray], dict[str, dict[str, Any]]]:
        """Start an episode.

        Args:
            seed: Seed of the episode; None continues the stream of random numbers, or draws a seed
                for the first episode.
            options: Not used.

        Returns:
            The observation of each agent, and an empty dictionary for each agent.
        """
        if seed is None and not self.batch.begun.all():
            seed = int(self._draws.integers(2**31))
        self.batch.reset(None if seed is None else [seed])
        self.agents = list(self.possible_agents)
        return self._observed(self.batch.observation), {agent: {} for agent in self.agents}

    def step(self, actions: Mapping[str, Any]) -> tuple[dict[str, Any], ...]:
        """Take one decision; give the action of each agent that drives.

        Raises:
            UserError: If one is missing or isn't an action of the road.
        """
        if not self.agents:
            return {}, {}, {}, {}, {}
        missing = sorted({*self.agents} - {*actions})
        if missing:
            raise UserError(f"the action of {missing[0]} is missing")
        width = self.world.action_size
        chosen = np.zeros((*self.batch.shape, width) if width else self.batch.shape, np.float32)
        for agent in self.agents:
            action = np.asarray(actions[agent])
            if not width and (action.size != 1 or action.dtype.kind not in "iu"):
                raise UserError(f"the action of {agent} must be a whole number, got {action}")
            if width and action.shape != (width,):
                raise UserError(f"the action of {agent} must be {width} numbers, got {action}")
            chosen[0, self._numbers[agent]] = action if width else action.item()
        chosen = chosen if width else chosen.astype(np.int64)
        decisions = self.batch.step(chosen, auto_reset=False)
        observations = self._observed(decisions.observation)
        departures = self._departures(decisions)
        rewards = {}
        infos = {}
        for agent in self.agents:
            number = self._numbers[agent]
            rewards[agent] = float(score(self._weights[number], decisions.rewards)[0, number])
            infos[agent] = facts_of(decisions, (0, number))
        terminated = {agent: departures[agent] == "terminated" for agent in self.agents}
        truncated = {agent: departures[agent] == "truncated" for agent in self.agents}
        self.agents = [agent for agent in self.agents if not departures[agent]]
        return observations, rewards, terminated, truncated, infos

    def _departures(self, decisions: Decisions) -> dict[str, str]:
        """Return how each agent leaves after a decision; "" if it stays."""
        ending = decisions.ending[0]
        joint = getattr(self.world.options, "ends", "") == "joint"
        if joint and self.batch.running[0]:
            return dict.fromkeys(self.agents, "")
        together = joint and int(Ending.TIMEOUT) not in ending
        departures = {}
        for agent in self.agents:
            kind = int(ending[self._numbers[agent]])
            stays = "" if kind == int(Ending.NONE) else "truncated"
            departures[agent] = "terminated" if together or kind in TERMINAL else stays
        return departures

    def _observed(self, observation: np.ndarray) -> dict[str, np.ndarray]:
        observation = with_time(observation, self.batch.clocks, self._clock)
        return {agent: observation[0, self._numbers[agent]] for agent in self.agents}
