"""Means over several policies; an angle only over policies of one angle."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from socialiq.errors import UserError
from socialiq.nn.actor_policy import ActorPolicy
from socialiq.nn.q_policy import ValuePolicy
from socialiq.policies.card import trained_angle
from socialiq.social.angle import angle_of
from socialiq.storage import kind_of
from socialiq.worlds.intersection import atlas
from socialiq.worlds.situation import load_driver


def pool(rows: Sequence[dict[str, Any]], targets: Sequence[float | None]) -> dict[str, Any]:
    """Return the means over policies of common numbers.

    The angle is that of the mean totals, if all policies were trained for one angle. Otherwise it
    would describe none of them, and `angle_not_pooled` says why there is none.

    Args:
        rows: Metrics of each policy.
        targets: Angle in degrees for which each was trained, None where it is not known.
    """
    names = [name for name in rows[0] if all(isinstance(row.get(name), float) for row in rows)]
    # Intervals belong to one policy's episodes: they can't be averaged.
    names = [name for name in names if not name.endswith(("_low", "_high"))]
    means: dict[str, Any] = {name: float(np.mean([row[name] for row in rows])) for name in names}
    if len(set(targets)) == 1 and targets[0] is not None:
        return means | {"angle": angle_of(means["r_env"], means["r_social"])}
    means.pop("angle", None)
    angles = sorted({target for target in targets if target is not None})
    why = f"the policies were trained for {', '.join(f'{target:g}' for target in angles)} degrees"
    if None in targets:
        why = "it is not known whether the policies were trained for one angle"
    return means | {"angle_not_pooled": why}


def target_of(name: str) -> float | None:
    """Return the angle in degrees for which a policy was trained, None if it is not known.

    Args:
        name: Name of a policy of the atlas, or a file; another driver has no such angle.
    """
    name = name.removeprefix("atlas:")
    try:
        return trained_angle(_named(name).provenance)
    except UserError:
        return None


def _named(name: str) -> ValuePolicy | ActorPolicy:
    if name in atlas.names():
        return atlas.load(name)
    if name in atlas.names(atlas.CONTINUOUS_STUDIES):
        return atlas.load_continuous(name)
    path = Path(name)
    return ActorPolicy.load(path) if kind_of(path) == ActorPolicy.KIND else load_driver(path)
