"""A dial where nothing can be listed: every angle driven, and mixtures from the episodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int64

from socialiq.errors import UserError
from socialiq.evaluation.dial_exact import Sweep
from socialiq.evaluation.exact import Readout
from socialiq.evaluation.play import episodes_of
from socialiq.nn.dial_policy import DialPolicy
from socialiq.social.dial import Setting, setting
from socialiq.social.estimate import AngleEstimate, estimate_angle
from socialiq.worlds.intersection.batch import Batch


@dataclass(frozen=True)
class Rolled:
    """What a dial did at each angle, on seeds that all angles share.

    Attributes:
        sweep: Means over all episodes.
        totals: Sums of (r_env, r_social) of each episode, by angle.
    """

    sweep: Sweep
    totals: tuple[Float[np.ndarray, "episode 2"], ...]

    def mixture(self, wanted: float, seed: int) -> tuple[Setting, AngleEstimate]:
        """The mixture of two queried policies whose behaviour lies at an angle.

        The first half of the episodes chooses it, the second half measures it: an interval over the
        episodes that chose would be about its own wish. Both policies drove the same seeds, so what
        is resampled is the mixture's expected sums on a seed.

        Args:
            wanted: Behavioural angle in degrees.
            seed: Of the bootstrap.

        Raises:
            UserError: If no mixture of these policies has this angle.
        """
        half = len(self.totals[0]) // 2
        one = setting(np.array([sums[:half].mean(axis=0) for sums in self.totals]), wanted)
        fresh = np.stack([sums[half:] for sums in self.totals])
        on_seed = (1.0 - one.share) * fresh[one.first] + one.share * fresh[one.second]
        return one, estimate_angle(on_seed[:, 0], on_seed[:, 1], seed)


def roll(
    dial: DialPolicy,
    batch: Batch,
    angles: Sequence[float],
    seeds: Int64[np.ndarray, " episode"],
    readout: Readout = "greedy",
) -> Rolled:
    """Drive a dial at some angles.

    Args:
        dial: The dial.
        batch: Where to drive.
        angles: In degrees, rising.
        seeds: One for each episode; every angle drives them all.
        readout: "greedy" or "soft".

    Raises:
        UserError: If there are fewer than two episodes, or an angle is outside the dial's range.
    """
    if len(seeds) < 2:
        raise UserError("a mixture needs two episodes or more: one half chooses, one measures")
    driven = [
        episodes_of(batch, dial.at(angle), seeds, deterministic=readout == "greedy")
        for angle in angles
    ]
    return Rolled(
        Sweep(tuple(angles), tuple(one.metrics() for one in driven)),
        tuple(np.stack([one.totals.env, one.totals.social], axis=1) for one in driven),
    )
