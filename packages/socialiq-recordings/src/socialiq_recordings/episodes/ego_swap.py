"""Ego swap: every vehicle that meets a conflict becomes the ego of one episode."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.types import Ending, RewardPair
from socialiq_recordings.conflicts.influence import unreasoned
from socialiq_recordings.conflicts.pairs import Encounters
from socialiq_recordings.episodes.annotate import Driven, driven
from socialiq_recordings.episodes.config import EpisodeConfig
from socialiq_recordings.episodes.scene import Scene
from socialiq_recordings.recording import Recording
from socialiq_recordings.road.routes import OFF_THE_MAP, Crossing
from socialiq_recordings.simulated_source import signs_of_simulation
from socialiq_recordings.tracks import Tracks

HUMAN = "human"
"""Mode of all recorded drivers: a recording doesn't contain their intentions."""

SIMULATED = "simulated"
"""Mode of the vehicles of a recording that was simulated (`simulated_source`)."""

NOT_A_VEHICLE = "not a vehicle"
OFF_THE_ROAD = "off the lanelets"
NO_JUNCTION = "never at a conflict area"
ALONE = "nobody in its way near in time"  # codespell:ignore
_LARGEST_JUMP = 5.0  # m
_MOVING = 0.5  # m/s; tracks that never reach it are indistinguishable

TOO_SHORT = "in view for less than a decision"
NO_WAY = "its way doesn't fit the lanelets"
DUPLICATE = "the same moments in another recording"
REASONS = (NOT_A_VEHICLE, OFF_THE_ROAD, NO_JUNCTION, ALONE, TOO_SHORT, NO_WAY, DUPLICATE)
"""Reasons for which a track makes no episode, in the order of the checks."""


@dataclass(frozen=True, eq=False)
class Swapped:
    """Episodes of one recording.

    Attributes:
        recording: Name of the recording.
        n_tracks: Number of road users.
        seconds: Time from the first frame to the last.
        source: Provenance of the recording.
        identity: The file's number of each episode's ego.
        episodes: Episode of each ego.
        left_out: Number of tracks without an episode, by reason.
        conflicts: Pairs of lanelets in conflict.
        moments: Signature of every track that moves.
        config: The options.
        site: Name of the site; "" if sites were not identified (`recordings.identity`).
        chain: Name of the chain of recordings that share vehicles; "" likewise.
        vehicle: Number of each episode's vehicle over all recordings; empty likewise.
        simulated: Signs that the recording was simulated; empty if there are none.
    """

    recording: str
    n_tracks: int
    seconds: float
    source: dict[str, Any]
    identity: tuple[int, ...]
    episodes: tuple[Driven, ...]
    left_out: dict[str, int]
    conflicts: int
    moments: frozenset[bytes]
    config: EpisodeConfig
    site: str = ""
    chain: str = ""
    vehicle: tuple[int, ...] = ()
    simulated: tuple[str, ...] = ()

    @property
    def n_transitions(self) -> int:
        """Number of decisions of all episodes."""
        return sum(len(one.action) for one in self.episodes)

    @property
    def counts(self) -> dict[str, Any]:
        """Return a table row with counts of tracks, episodes and reasons."""
        endings = Counter(int(one.ending[-1]) for one in self.episodes)
        return {
            "recording": self.recording,
            "site": self.site,
            "chain": self.chain,
            "origin": SIMULATED if self.simulated else "recorded",
            "seconds": round(self.seconds, 2),
            "tracks": self.n_tracks,
            "conflicts": self.conflicts,
            "episodes": len(self.episodes),
            "transitions": self.n_transitions,
            "arrivals": endings[int(Ending.ARRIVAL)],
            "collisions": endings[int(Ending.COLLISION)],
            "truncated": endings[int(Ending.TIMEOUT)],
        } | {reason: self.left_out.get(reason, 0) for reason in REASONS}


def swap(recording: Recording, config: EpisodeConfig | None = None) -> Swapped:
    """Make every vehicle that meets a conflict the ego of one episode.

    A vehicle that meets conflicts at several junctions drives its episode over the first.

    Args:
        recording: Tracks and road.
        config: Options; by default those of `EpisodeConfig`.

    Raises:
        UserError: If there is no road network, the policy rate doesn't fit the recording's, or
            Shapely is not installed.
    """
    chosen = config or EpisodeConfig()
    scene = Scene(recording)
    chosen.options_at(scene.tracks.dt)
    encounters = Encounters(scene) if chosen.influence == "reasoned" else None
    made: list[Driven] = []
    left_out: Counter[str] = Counter()
    for track in range(scene.tracks.n_tracks):
        found = _episode(scene, track, chosen, encounters)
        if isinstance(found, str):
            left_out[found] += 1
        else:
            made.append(found)
    tracks = scene.tracks
    return Swapped(
        tracks.recording,
        tracks.n_tracks,
        float(np.ptp(tracks.frame) * tracks.dt) if tracks.n_states else 0.0,
        tracks.source,
        tuple(int(tracks.identity[one.track]) for one in made),
        tuple(made),
        dict(left_out),
        len(scene.lanes.conflicts),
        moments_of(tracks),
        chosen,
        simulated=signs_of_simulation(tracks),
    )


def _episode(
    scene: Scene, track: int, config: EpisodeConfig, encounters: Encounters | None
) -> Driven | str:
    """Return a vehicle's episode, or the reason for which there is none."""
    if track not in scene.vehicles:
        return NOT_A_VEHICLE
    if scene.matched(track).off > OFF_THE_MAP:
        return OFF_THE_ROAD
    near = [j for j in scene.junctions(track) if scene.presence(track, j, config.reach) is not None]
    if not near:
        return NO_JUNCTION
    met = next((junction for junction in near if meets(scene, track, junction, config)), None)
    if met is None:
        return ALONE
    way = scene.crossing(track, met)
    assert way is not None  # the junction is on its way
    without = None if encounters is None else partial(unreasoned, encounters, track)
    found = driven(scene, track, way, config, without)
    if found is None:
        return TOO_SHORT
    return found if found.jump <= _LARGEST_JUMP else NO_WAY


def episode_of(recording: Recording, identity: int, config: EpisodeConfig) -> Driven:
    """Return the episode of one vehicle, by its number in the file.

    Raises:
        UserError: If there is no such vehicle, or it makes no episode; the line has the reason.
    """
    scene, name = Scene(recording), recording.tracks.recording
    found = np.flatnonzero(scene.tracks.identity == identity)
    if len(found) == 0:
        raise UserError(
            f"no vehicle {identity} in {name}: choose one of its {scene.tracks.n_tracks}"
        )
    encounters = Encounters(scene) if config.influence == "reasoned" else None
    episode = _episode(scene, int(found[0]), config, encounters)
    if isinstance(episode, str):
        raise UserError(f"vehicle {identity} of {name} makes no episode: {episode}")
    return episode


def meets(scene: Scene, track: int, junction: int, config: EpisodeConfig) -> bool:
    """Whether another vehicle's way conflicts with a vehicle's, close in time."""
    way, own = scene.crossing(track, junction), scene.presence(track, junction, config.reach)
    if way is None or own is None:
        return False
    for other in scene.vehicles.tolist():
        others = None if other == track else scene.presence(other, junction, config.reach)
        if others is None or scene.matched(other).off > OFF_THE_MAP:
            continue
        apart = max(others[0] - own[1], own[0] - others[1], 0) * scene.tracks.dt
        their_way = scene.crossing(other, junction)
        assert their_way is not None  # it is at the junction
        if apart <= config.near and _in_conflict(scene, track, way, other, their_way):
            return True
    return False


def _in_conflict(scene: Scene, track: int, way: Crossing, other: int, other_way: Crossing) -> bool:
    own = scene.matched(track).lanelets[way.first : way.last + 1]
    others = scene.matched(other).lanelets[other_way.first : other_way.last + 1]
    return any(scene.lanes.conflict(one, two) for one in own for two in others)


def moments_of(tracks: Tracks) -> frozenset[bytes]:
    """Return signatures of the moving tracks of a recording: their speeds, to 1 cm/s."""
    speed = np.round(np.hypot(tracks.vx, tracks.vy), 2) + 0.0
    each = np.split(speed, tracks.starts[1:-1])
    return frozenset(one.tobytes() for one in each if len(one) and one.max() > _MOVING)


def check_distinct(swapped: Sequence[Swapped]) -> None:
    """Raise an error for recordings that were given twice, under the same or different names.

    Raises:
        UserError: If two have one name, or more than half of one's moving tracks are in another.
    """
    for number, one in enumerate(swapped):
        for other in swapped[:number]:
            if one.recording == other.recording:
                raise UserError(
                    f"two recordings are named '{one_line(one.recording)}': give each only once"
                )
            if one.chain and other.chain:
                continue  # what they have in common is known, and was dropped or kept on purpose
            shared = len(one.moments & other.moments)
            if shared > 0.5 * min(len(one.moments), len(other.moments)) > 0:
                raise UserError(
                    f"{one_line(other.recording)} and {one_line(one.recording)} hold the same "
                    f"moments ({shared} tracks are equal): leave one of them out"
                )


def demonstrations(swapped: Sequence[Swapped], as_human: bool = False) -> Demonstrations:
    """Return a table of all episodes, each with its recording and vehicle in `source`.

    Args:
        swapped: Episodes by recording.
        as_human: Whether simulated vehicles get the mode of people, too.

    Raises:
        UserError: If no recording has an episode, two have the same name, or they were read
            differently.
    """
    check_distinct(swapped)
    configs = {repr(one.config) for one in swapped}
    if len(configs) > 1:
        raise UserError("the recordings were read under different choices: read them alike")
    episodes = [one for each in swapped for one in each.episodes]
    if not episodes:
        raise UserError(
            "no vehicle of these recordings meets a conflict: look at the counts for the reasons"
        )
    sizes = [len(one.action) for one in episodes]
    pairs = np.concatenate([one.pair for one in episodes])
    simulated = [bool(each.simulated) and not as_human for each in swapped for _ in each.episodes]
    names = tuple(name for name, kind in ((HUMAN, False), (SIMULATED, True)) if kind in simulated)
    modes = [names.index(SIMULATED if one else HUMAN) for one in simulated]
    return Demonstrations.of(
        observation=np.concatenate([one.observation[:-1] for one in episodes]),
        action=np.concatenate([one.action for one in episodes]),
        next_observation=np.concatenate([one.observation[1:] for one in episodes]),
        ending=np.concatenate([one.ending for one in episodes]),
        rewards=RewardPair(*pairs.T),
        episode=np.repeat(np.arange(len(sizes)), sizes),
        mode=np.repeat(np.array(modes, np.int8), sizes),
        mode_names=names,
        n_actions=swapped[0].config.n_actions,
        source=_source(swapped),
    )


def _source(swapped: Sequence[Swapped]) -> dict[str, Any]:
    residual = np.concatenate([one.residual for each in swapped for one in each.episodes])
    return {
        "made_by": "ego swap",
        "reading": asdict(swapped[0].config),
        "recordings": [
            {
                "name": one.recording,
                "site": one.site,
                "chain": one.chain,
                "simulated": list(one.simulated),
                "source": one.source,
                "egos": list(one.identity),
            }
            for one in swapped
        ],
        "episode_recording": [p for p, one in enumerate(swapped) for _ in one.episodes],
        "episode_identity": [number for one in swapped for number in one.identity],
        "residual_rms": float(np.sqrt(np.mean(residual**2))),
    }
