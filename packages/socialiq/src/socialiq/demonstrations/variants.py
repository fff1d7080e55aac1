"""Demonstrations in another form: with mirror images, or with absorbing terminal states.

A symmetry is knowledge about the world beside the data, declared by the user: in a comparison all
learners need it.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.types import Ending, RewardPair


@dataclass(frozen=True)
class Symmetry:
    """A map of a world onto itself that is its own inverse, as a mirror's is.

    Raises:
        UserError: If the map applied twice would not give back what it was applied to.
    """

    signs: tuple[int, ...]  # of each feature of the image: 1, or -1 where it changes sign
    actions: tuple[int, ...]  # of each action, the action of the image
    # of each feature of the image, the feature it is taken from; the same without it
    features: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        """Refuse a map that is not its own inverse."""
        if not self.features:
            object.__setattr__(self, "features", tuple(range(len(self.signs))))
        for name, order in (("features", self.features), ("actions", self.actions)):
            complete = sorted(order) == list(range(len(order)))
            if not complete or any(order[order[index]] != index for index in order):
                raise UserError(f"{name} of a symmetry must name pairs that change places: {order}")
        pairs = zip(self.features, self.signs, strict=False)
        fits = len(self.features) == len(self.signs)
        if not fits or any(sign * self.signs[image] != 1 for image, sign in pairs):
            raise UserError(f"signs of a symmetry must be 1 or -1, alike in a pair: {self.signs}")

    def image(
        self, observation: Float[np.ndarray, "batch feature"]
    ) -> Float[np.ndarray, "batch feature"]:
        """Return the image of each observation."""
        return observation[:, self.features] * np.array(self.signs, observation.dtype)


def with_images(data: Demonstrations, symmetry: Symmetry) -> Demonstrations:
    """Return the episodes, then the image of each, with the same rewards and endings."""
    sizes = (len(symmetry.signs), len(symmetry.actions))
    if sizes != (data.n_features, data.n_actions):
        raise UserError(
            f"the symmetry is of {sizes[0]} features and {sizes[1]} actions, the demonstrations "
            f"have {data.n_features} and {data.n_actions}: they belong to another world"
        )
    images = dataclasses.replace(
        data,
        observation=symmetry.image(data.observation),
        action=np.array(symmetry.actions, np.int32)[data.action],
        next_observation=symmetry.image(data.next_observation),
    )
    columns = {
        name: np.concatenate([column, images.arrays()[name]])
        for name, column in data.arrays().items()
    }
    columns["episode"][data.n_transitions :] += data.n_episodes
    source = {"made_by": "with_images", "symmetry": dataclasses.asdict(symmetry), "of": data.source}
    return Demonstrations.of_arrays(columns, data.mode_names, data.n_actions, source)


def with_absorbing_states(data: Demonstrations, stay: int = 1) -> Demonstrations:
    """Return the same episodes, with terminal states as absorbing ones (Kostrikov et al. 2019).

    As `worlds.wrapper.AbsorbingStates` would have given them: observations get a last number, 1 in
    the absorbing state, where the others are 0. A transition into a terminal state leads there, and
    `stay` rows in which it is not left follow, with the action before, no reward, and a timeout at
    their end.
    """
    if stay < 1:
        raise UserError(f"stay must be at least 1, got {stay}")
    ends = data.terminated.nonzero()[0]
    repeats = np.ones(data.n_transitions, int)
    repeats[ends] += stay
    rows = np.arange(data.n_transitions).repeat(repeats)
    copied = np.append(False, rows[1:] == rows[:-1])
    last = np.append(copied[:-1] & ~copied[1:], copied[-1:])
    absorbed = np.append(np.zeros(data.n_features), 1.0)
    before = np.column_stack([data.observation, np.zeros(data.n_transitions)])[rows]
    after = np.column_stack([data.next_observation, np.zeros(data.n_transitions)])[rows]
    before[copied], after[data.terminated[rows]] = absorbed, absorbed
    ending = np.where(data.terminated[rows], int(Ending.NONE), data.ending[rows])
    ending[last] = int(Ending.TIMEOUT)
    pairs = (np.where(copied, 0.0, column[rows]) for column in data.rewards)
    return Demonstrations.of(
        observation=before,
        action=data.action[rows],
        next_observation=after,
        ending=ending,
        rewards=RewardPair(*pairs),
        episode=data.episode[rows],
        n_actions=data.n_actions,
        mode=data.mode[rows],
        mode_names=data.mode_names,
        source={"made_by": "with_absorbing_states", "stay": stay, "of": data.source},
    )
