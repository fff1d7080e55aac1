"""Symmetries of a world, declared by the user: demonstrations with their mirror images.

A symmetry is knowledge about the world beside the data: in a comparison all learners need it.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError


@dataclass(frozen=True)
class Symmetry:
    """A map of a world onto itself that is its own inverse, as a mirror's is.

    Attributes:
        signs: Of each feature of the image: 1, or -1 where it changes sign.
        actions: Of each action, the action of the image.
        features: Of each feature of the image, the feature it is taken from; the same without it.

    Raises:
        UserError: If the map applied twice would not give back what it was applied to.
    """

    signs: tuple[int, ...]
    actions: tuple[int, ...]
    features: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        """Refuse a map that is not its own inverse."""
        if not self.features:
            object.__setattr__(self, "features", tuple(range(len(self.signs))))
        for name, order in (("features", self.features), ("actions", self.actions)):
            known = sorted(order) == list(range(len(order)))
            if not known or any(order[order[place]] != place for place in order):
                raise UserError(f"{name} of a symmetry must name pairs that change places: {order}")
        pairs = zip(self.features, self.signs, strict=False)
        fits = len(self.features) == len(self.signs)
        if not fits or any(one * self.signs[other] != 1 for other, one in pairs):
            raise UserError(f"signs of a symmetry must be 1 or -1, alike in a pair: {self.signs}")

    def image(
        self, observation: Float[np.ndarray, "batch feature"]
    ) -> Float[np.ndarray, "batch feature"]:
        """Return the image of each observation."""
        return observation[:, self.features] * np.array(self.signs, observation.dtype)


def with_images(data: Demonstrations, symmetry: Symmetry) -> Demonstrations:
    """Return the episodes, then the image of each, with the same rewards and endings.

    Args:
        data: Demonstrations.
        symmetry: Of their world.

    Raises:
        UserError: If the symmetry is one of other observations or actions.
    """
    given = (data.n_features, data.n_actions)
    wanted = (len(symmetry.signs), len(symmetry.actions))
    if given != wanted:
        raise UserError(
            f"the symmetry is of {wanted[0]} features and {wanted[1]} actions, "
            f"the demonstrations have {given[0]} and {given[1]}: they belong to another world"
        )
    images = dataclasses.replace(
        data,
        observation=symmetry.image(data.observation),
        action=np.array(symmetry.actions, np.int32)[data.action],
        next_observation=symmetry.image(data.next_observation),
    )
    columns = {
        name: np.concatenate([one, images.arrays()[name]]) for name, one in data.arrays().items()
    }
    columns["episode"][data.n_transitions :] += data.n_episodes
    source = {"made_by": "with_images", "symmetry": dataclasses.asdict(symmetry), "of": data.source}
    return Demonstrations.of_arrays(columns, data.mode_names, data.n_actions, source)
