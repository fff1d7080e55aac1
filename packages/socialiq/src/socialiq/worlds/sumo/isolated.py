"""SUMO that reads files of users, in a sandbox: it parses XML in C++ and can write files.

A child process plays the episodes. It gets the scene and the actions, and answers in JSON, which
runs no code in the parent: a file that takes over SUMO gets no further.
"""

from __future__ import annotations

import base64
import functools
import hashlib
import json
import os
import pickle
import sys
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32

from socialiq.child import Child
from socialiq.errors import UserError
from socialiq.isolation import NOT_NEEDED, CodeHash, Isolation, isolation_of, sandboxed
from socialiq.types import Ending
from socialiq.worlds.highway.options import FEATURES, Contact
from socialiq.worlds.sumo.network import CLASSES, NETS
from socialiq.worlds.sumo.simulation import Body, EgoState, Episode, Frame, Result
from socialiq.worlds.sumo.traffic import Scene

SECONDS = 600.0  # for an answer: a reset plays the traffic of a city twice
_MOST = 256 * 1024**2  # bytes of an answer
_PROGRAM = (
    "import sys; sys.path.insert(0, {root!r}); "
    "from socialiq.worlds.sumo.isolated import serve; serve()"
)
_NO_FILES = CodeHash("", "", {})


def isolation_for(scene: Scene) -> Isolation:
    """Return the isolation of SUMO for a scene; none is needed if it reads no file of a user.

    Args:
        scene: The scene.
    """
    is_shipped = scene.options.net in NETS and scene.user_demand is None
    return NOT_NEEDED if is_shipped else isolation_of("auto")


def episode_of(scene: Scene, seed: int) -> Episode | IsolatedEpisode:
    """Begin an episode, in a sandbox if SUMO reads a user's file and this system has one.

    Args:
        scene: The scene.
        seed: Seed of the episode.

    Raises:
        UserError: If libsumo is missing, or SUMO refuses the network.
    """
    isolation = isolation_for(scene)
    is_apart = isolation.works and isolation != NOT_NEEDED
    return IsolatedEpisode(scene, seed) if is_apart else Episode(scene, seed)


class IsolatedEpisode:
    """Episode in a sandbox.

    Attributes:
        without: What others drive without the ego to the common end, m by name.
        observation: Rows of the ego and of vehicles and bicycles near it, as at the intersection.
        bodies: The ego and the other road users, as the ego sees the road.
        ego_state: Facts that the ego knows of itself.

    Raises:
        UserError: If libsumo is missing, or SUMO refuses the network.
    """

    def __init__(self, scene: Scene, seed: int) -> None:
        self.scene = scene
        self.seed = seed
        self.actions = list[int]()
        self.observation: Float32[np.ndarray, " feature"]
        self.without: dict[str, float] = self._answer()["without"]

    def step(self, action: int) -> Result:
        """Take a decision.

        Args:
            action: 0 slower, 1 idle, 2 faster.
        """
        self.actions.append(action)
        return _result_of(self._answer()["result"])

    def _answer(self) -> dict[str, Any]:
        answer = _sandbox(os.getpid()).ask(self.scene, self.seed, self.actions)
        rows = self.scene.options.road.observed_vehicles * len(FEATURES)
        self.observation = np.array(answer["observation"], np.float32).reshape(rows)
        self.bodies = [Body(*body) for body in answer["bodies"]]
        junction, frame, target_speed = answer["ego_state"]
        self.ego_state = EgoState(junction, Frame(*frame), target_speed)
        return answer


def _result_of(fields: list[Any]) -> Result:
    """Return the outcome of a decision from its JSON."""
    ending, contact, partner, advance, speed, caused, encounter = fields
    return Result(
        Ending(ending),
        Contact(contact),
        str(partner),
        float(advance),
        float(speed),
        np.array(caused, np.float64).reshape(len(CLASSES), 3),
        np.array(encounter, np.float64).reshape(len(CLASSES)),
    )


class _Sandbox:
    """The process of SUMO, which is started again after it has ended."""

    def __init__(self) -> None:
        self._child: Child | None = None
        self._known: str = ""  # scene that the child has

    def ask(self, scene: Scene, seed: int, actions: list[int]) -> dict[str, Any]:
        """Return the state of an episode after some actions, as `_Player.play` answers."""
        source = f"SUMO with {scene.network.file.name}"
        if self._child is None:
            root = str(Path(__file__).parents[3])
            program = [sys.executable, "-I", "-c", _PROGRAM.format(root=root)]
            self._child = Child(sandboxed(program, _NO_FILES, library=True), source)
        content = _pickled(scene)
        key = hashlib.sha256(content).hexdigest()
        request: dict[str, Any] = {"key": key, "seed": seed, "actions": actions}
        if key != self._known:
            request["scene"] = base64.b64encode(content).decode()
        self._child.source = source
        try:
            answer = self._child.request(request, SECONDS, _MOST)
        except BaseException:  # an interrupted child still has an answer to give
            self._child.close()
            self._child = None
            self._known = ""
            raise
        self._known = key
        if "refused" in answer:
            raise UserError(str(answer["refused"]))
        return answer


@functools.cache
def _sandbox(_process: int) -> _Sandbox:
    """Return the sandbox of a process: a copy of it by `fork` would share the pipes."""
    return _Sandbox()


@functools.lru_cache(maxsize=4)
def _pickled(scene: Scene) -> bytes:
    return pickle.dumps(scene)


class _Player:
    """Plays episodes in the sandbox; keeps the last one, since SUMO holds one."""

    def __init__(self) -> None:
        self._key = ""
        self._scene: Scene | None = None
        self._episode: Episode | None = None

    def play(self, request: dict[str, Any]) -> dict[str, Any]:
        """Return the state of an episode after some actions, as JSON."""
        if "scene" in request:
            self._scene = pickle.loads(base64.b64decode(request["scene"]))
            self._key = request["key"]
            self._episode = None
        assert self._scene is not None
        actions = request["actions"]
        episode = self._episode
        if (
            episode is None
            or episode.seed != request["seed"]
            or episode.actions != actions[:-1]
            or not actions
        ):
            episode = self._episode = Episode(self._scene, request["seed"])
        result = None
        for action in actions[len(episode.actions) :]:
            result = episode.step(action)
        answer = {"observation": episode.observation.tolist(), "bodies": episode.bodies}
        answer["ego_state"] = episode.ego_state
        if result is None:
            return answer | {"without": episode.without}
        numbers = [result.caused.tolist(), result.encounter.tolist()]
        return answer | {"result": [*result[:5], *numbers]}


def serve() -> None:
    """Answer the requests of a parent, a line each, until it closes the pipe."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # SUMO prints on standard output
    player = _Player()
    for line in sys.stdin:
        try:
            answer = player.play(json.loads(line))
        except UserError as error:
            answer = {"refused": str(error)}
        answers.write(json.dumps(answer) + "\n")
        answers.flush()
