"""Demonstrations of the intersection in the page: the episodes of a file, one by one."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from statistics import NormalDist
from typing import Any

import numpy as np
from jaxtyping import Float32
from scipy.optimize import linear_sum_assignment

from socialiq.demonstrations import files
from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.social.angle import angle_of
from socialiq.types import Ending
from socialiq.view import View
from socialiq.worlds.grammar import road_of
from socialiq.worlds.highway.options import FEATURES
from socialiq.worlds.intersection.options import POSITION_RANGE, SPEED_RANGE, Options

MOST_SEED = 2**53
"""Seeds from here on are no whole numbers of the page's program."""

RECORDED = ("socialiq data world", "ego swap")
"""Makers of demonstrations of recorded drivers, whose road is another."""


class Replay:
    """Episodes of a file of demonstrations of the intersection, as the page shows them.

    Raises:
        UserError: If it is damaged, or of another world.
    """

    def __init__(self, path: Path) -> None:
        self._table = table = files.load(path)
        if table.source.get("made_by") in RECORDED:
            raise UserError(
                f"{path} holds drivers of a recorded road, not of the intersection: name the "
                "recording itself to see them"
            )
        world = road_of()
        ego = table.observation[:, : len(FEATURES)].astype(np.float64)
        fits = table.n_features in (world.n_features, world.n_features + 1)
        fits = fits and table.n_actions == world.n_actions
        if fits:
            turned = np.abs(np.hypot(ego[:, 5], ego[:, 6]) - 1.0) < 1e-3
            placed = (ego[:, 0] == 1.0).all() and (np.abs(ego[:, 1:5]) <= 1.0).all()
            fits = bool(turned.all() and placed)
        if not fits:
            raise UserError(
                f"{path} has {table.n_features} features and {table.n_actions} actions and is not "
                f"of the intersection ({world.n_features} and {world.n_actions}, absolute places): "
                "view shows demonstrations of that world alone"
            )
        self._seeds = seeds_of(table.source, table.n_episodes)
        self._starts = [*table.episode_starts.tolist(), table.n_transitions]
        self._seconds = 1 / Options().policy_frequency

    def episode(self, number: int) -> dict[str, Any]:
        """Return an episode by its number from 0, JSON-compatible."""
        table = self._table
        rows = slice(self._starts[number], self._starts[number + 1])
        steps = table.step[rows]
        complete = steps.tolist() == list(range(len(steps)))
        # The last scene is what the last decision led to.
        observations = np.concatenate([table.observation[rows], table.next_observation[rows][-1:]])
        features = road_of().n_features
        return {
            "mode": one_line(table.mode_names[table.mode[rows][0]], 60),
            "seed": self._seeds[number] if complete and self._seeds else None,
            "steps": steps.tolist(),
            "actions": table.action[rows].tolist(),
            "rewards": np.stack(table.rewards, axis=1)[rows].tolist(),
            "ending": int(table.ending[rows][-1]),
            "observations": table.observation[rows][:, :features].tolist(),
            "scenes": scenes_of(observations, self._seconds),
        }

    def modes(self) -> list[dict[str, Any]]:
        """Return means of the episodes of each mode, rewards with a normal 95 % interval."""
        table = self._table
        modes = []
        env, social = self._sums()
        last = table.ending[np.array(self._starts[1:]) - 1]
        for number, name in enumerate(table.mode_names):
            chosen = table.episode_modes == number
            if not chosen.any():
                continue
            means = {"env": _mean(env[chosen]), "social": _mean(social[chosen])}
            modes.append(
                {
                    "mode": one_line(name, 60),
                    "episodes": int(chosen.sum()),
                    **means,
                    "angle": angle_of(means["env"][0], means["social"][0]),
                    "arrival": float((last[chosen] == Ending.ARRIVAL).mean()),
                    "collision": float((last[chosen] == Ending.COLLISION).mean()),
                }
            )
        return modes

    def notable(self) -> list[dict[str, Any]]:
        """Return episodes to begin with: those of extreme rewards, the first of each ending."""
        env, social = self._sums()
        last = self._table.ending[np.array(self._starts[1:]) - 1]
        episodes = {
            "most own progress": int(env.argmax()),
            "best for others": int(social.argmax()),
            "worst for others": int(social.argmin()),
        }
        for ending, why in ((Ending.COLLISION, "a collision"), (Ending.TIMEOUT, "out of time")):
            rows = np.flatnonzero(last == ending)
            episodes |= {why: int(rows[0])} if len(rows) else {}
        return [{"episode": number, "why": why} for why, number in episodes.items()]

    def _sums(self) -> tuple[np.ndarray, np.ndarray]:
        """Return both rewards summed over the rows of each episode; some steps may be left out."""
        starts = self._table.episode_starts
        env, social = (np.add.reduceat(reward, starts) for reward in self._table.rewards)
        return env, social


def demonstrations_view(path: Path) -> View:
    """Return a file of demonstrations of the intersection as content of the page.

    Raises:
        UserError: If it is damaged, or not of the intersection.
    """
    replay = Replay(path)
    modes = replay.modes()
    count = sum(mode["episodes"] for mode in modes)
    return View(
        kind="episodes",
        title=one_line(path.name, 60),
        lead=f"{count:,} recorded episodes of the intersection, as they were driven.",
        data={"modes": modes, "notable": replay.notable(), "curve": True},
        count=count,
        part=replay.episode,
    )


def seeds_of(source: Mapping[str, Any], episodes: int) -> list[int] | None:
    """Return the seed of each episode by the provenance of a file, or None if it does not say.

    Args:
        source: Provenance of the file, with a list `seeds`, or with `first_seed` and `episodes`.
        episodes: Number of episodes in the file.

    Returns:
        One seed for each episode; None if the number of seeds differs or a seed is out of range.
    """
    seeds = source.get("seeds")
    first = source.get("first_seed")
    if type(first) is int and source.get("episodes") == episodes:
        seeds = list(range(first, first + episodes))
    if not isinstance(seeds, list) or len(seeds) != episodes:
        return None
    return seeds if all(type(seed) is int and 0 <= seed < MOST_SEED for seed in seeds) else None


def _mean(values: np.ndarray) -> list[float]:
    """Return a mean and its normal 95 % interval; that of one value is the value."""
    mean = float(values.mean())
    half = 0.0
    if len(values) > 1:
        half = NormalDist().inv_cdf(0.975) * float(values.std(ddof=1)) / len(values) ** 0.5
    return [mean, mean - half, mean + half]


FURTHEST = 7.0
"""Metres between a vehicle and where its speed would have taken it, within which it is the same."""

_FAR = 1e6


def scenes_of(
    observations: Float32[np.ndarray, "time feature"], seconds: float
) -> list[list[list[float | int]]]:
    """Return the vehicles in the ego's observations of one episode, by time.

    Args:
        observations: Observations as the policy takes them; a clock, if there is one, is ignored.
        seconds: Time between two observations, s.

    Returns:
        For each observation a list of vehicles, the ego first: x, y in m, heading in rad, speed in
        m/s, and a number that the same vehicle keeps.
    """
    rows = len(FEATURES) * (observations.shape[1] // len(FEATURES))
    before = np.empty((0, 7))
    names = np.empty(0, int)
    scenes = []
    next_name = 0
    for rows_of_scene in observations[:, :rows].reshape(len(observations), -1, len(FEATURES)):
        now = rows_of_scene[rows_of_scene[:, 0] > 0].astype(np.float64)
        numbers = _matched(before, names, now, seconds)
        new = np.flatnonzero(numbers < 0)
        numbers[new] = next_name + np.arange(len(new))
        next_name += len(new)
        scene = []
        for (_, x, y, vx, vy, cosine, sine), name in zip(now.tolist(), numbers, strict=True):
            heading = float(np.arctan2(sine, cosine))
            speed = float(np.hypot(vx, vy)) * SPEED_RANGE
            scene.append([x * POSITION_RANGE, y * POSITION_RANGE, heading, speed, int(name)])
        scenes.append(scene)
        before = now
        names = numbers
    return scenes


def _matched(before: Any, names: np.ndarray, now: Any, seconds: float) -> np.ndarray:
    """Return for each vehicle its name of before; -1 for a new one. The ego stays the ego."""
    numbers = np.full(len(now), -1)
    if not len(before) or not len(now):
        return numbers
    expected = before[:, 1:3] * POSITION_RANGE + before[:, 3:5] * SPEED_RANGE * seconds
    places = now[:, 1:3] * POSITION_RANGE
    apart = np.linalg.norm(expected[:, None] - places[None], axis=-1)
    apart[0, 1:] = apart[1:, 0] = _FAR
    apart[0, 0] = 0.0
    for old, new in zip(*linear_sum_assignment(apart), strict=True):
        if apart[old, new] <= FURTHEST:
            numbers[new] = names[old]
    return numbers
