"""Tasks of MO-Gymnasium, read from tasks.toml, and the exact front of a deterministic one."""

import json
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from socialiq import Ending, RewardPair, UserError, attainable_set, make_environment
from socialiq.foreign import one_line
from socialiq.mdp import front, tabular
from socialiq.storage import read_json
from socialiq_lab.comparison import as_file_name

ANGLES = tuple(float(angle) for angle in range(0, 91, 5))
"""Angles at which every policy is evaluated, in degrees."""


@dataclass(frozen=True)
class Task:
    """A two-objective task, and what all methods have in common there."""

    env: str
    steps: int  # steps in the environment that a method may take, those of its experts included
    reference: tuple[float, float]  # reference point of the hypervolume
    discount: float
    hidden: tuple[int, ...]
    batch_size: int
    episodes: int
    first_episode: int  # seed of the first evaluation episode
    peers: tuple[str, ...]  # methods of morl-baselines that are run on it
    exact: bool = False
    """Whether it is finite and deterministic, so that its exact front is computed."""
    continuous: bool = False
    options: Mapping[str, Any] = field(default_factory=dict)

    def make(self) -> Any:
        """Make the environment, whose vector reward is the pair."""
        try:
            kind = {"allow_code": True, "needs_pair": True, "continuous": True}
            return make_environment(f"mo_gymnasium:{self.env}", self.options, **kind)
        except UserError as error:
            raise UserError(
                f"{self.env} needs pip install 'socialiq-lab[mo]', and of the tasks of MuJoCo "
                f"'socialiq-lab[mujoco]': {one_line(str(error))}"
            ) from error

    def time_limit(self) -> int:
        """Return after how many steps an episode is cut off."""
        limit = getattr(self.make().spec, "max_episode_steps", None)
        assert limit is not None  # of every task
        return limit


TASKS: dict[str, Task] = {}  # tasks by name

for _name, _row in tomllib.loads(Path(__file__).with_name("tasks.toml").read_text()).items():
    _fields: Any = {k: tuple(v) if isinstance(v, list) else v for k, v in _row.items()}
    TASKS[_name] = Task(**_fields)


def enumerated(env: Any) -> tabular.TabularMDP:
    """Return the finite MDP of deep-sea-treasure: its states are `current_state`."""
    inner: Any = env.unwrapped
    env.reset(seed=0)
    numbers = {tuple(inner.current_state.tolist()): 0}
    waiting, rows = list(numbers), list[list[tuple[int, int, float, float]]]()
    count = int(inner.action_space.n)
    while waiting:
        state = waiting.pop(0)
        rows.append([])
        for action in range(count):
            env.reset()
            inner.current_state = np.array(state, np.int32)
            _, _, ended, _, info = env.step(action)
            reached = state if ended else tuple(inner.current_state.tolist())
            if reached not in numbers:
                numbers[reached] = len(numbers)
                waiting.append(reached)
            kind = Ending.OTHER if ended else Ending.NONE
            first, second = info["reward_pair"]
            rows[-1].append((numbers[reached], int(kind), float(first), float(second)))
    successor, ending, first, second = np.moveaxis(np.array(rows), 2, 0)
    return tabular.TabularMDP(
        successor=successor.astype(np.int64)[..., None],
        probability=np.ones((*successor.shape, 1)),
        ending=ending.astype(np.int64)[..., None],
        rewards=RewardPair(first, second),
        initial=np.eye(len(rows))[0],
    )


@cache
def exact_set(name: str) -> front.AttainableSet:
    """Return the attainable set of a finite task within its time limit."""
    task = TASKS[name]
    return attainable_set(enumerated(task.make()), task.time_limit())


def known_front(name: str) -> Float[np.ndarray, "point 2"]:
    """Return the front that MO-Gymnasium publishes for a task: all non-dominated totals."""
    inner: Any = TASKS[name].make().unwrapped
    return np.array(inner.pareto_front(gamma=1.0), np.float64)


FOLDER = "pieces"


@dataclass(frozen=True)
class Piece:
    """Outcome of one training."""

    task: str
    method: str
    seed: int
    steps: int  # steps taken in the environment to learn, those of its experts included
    evaluation_steps_while_training: int  # steps of evaluations that decide what is trained next
    angles: list[float] | None
    """Angle of each policy that can be turned, in degrees; None for a set of policies."""
    totals: list[list[float]]
    """Mean totals (first, second reward) of each angle, or of each policy of the set."""
    settings: dict[str, Any]  # settings that are not the method's own defaults
    seconds: float
    versions: dict[str, str]

    @property
    def file(self) -> str:
        """Name of its file."""
        return f"{self.task}-{as_file_name(self.method)}-{self.seed}.json"

    @property
    def points(self) -> Float[np.ndarray, "policy 2"]:
        """Mean totals of each policy."""
        return np.array(self.totals, np.float64).reshape(-1, 2)

    def content(self) -> bytes:
        """Return the content of its file: one line of JSON."""
        return (json.dumps(asdict(self), allow_nan=False) + "\n").encode()


def read(folder: Path) -> list[Piece]:
    """Return every piece of a folder, by name; none if the folder doesn't exist."""
    pieces = []
    for path in sorted(folder.glob("*.json")):
        refused = f"{path} is no piece of mo-gymnasium: restore or remove it"
        try:
            piece = Piece(**read_json(path))
            shape = np.array(piece.totals, np.float64).shape
            listed = piece.angles is None or len(piece.angles) == len(piece.totals)
        except (TypeError, ValueError) as error:
            raise UserError(refused) from error
        if piece.task not in TASKS or shape != (len(piece.totals), 2) or not (listed and shape[0]):
            raise UserError(refused)
        if not np.isfinite(piece.points).all() or path.name != piece.file:
            raise UserError(f"{path} is damaged or has another's name: restore or remove it")
        pieces.append(piece)
    return pieces


def within(pieces: Iterable[Piece], steps: dict[str, int]) -> list[Piece]:
    """Return the pieces of these tasks whose methods were allowed these steps.

    Pieces of ours say so as `allowed_steps` of their settings: where episodes of experts end early,
    fewer are taken. Of the others it is told by the steps taken: at most, and nearly, these.
    """
    chosen = []
    for piece in pieces:
        budget = steps.get(piece.task, -1)  # below all of another task
        told = piece.settings.get("allowed_steps")
        allowed = told == budget if told is not None else 0.9 * budget <= piece.steps
        if allowed and piece.steps <= budget:
            chosen.append(piece)
    return chosen
