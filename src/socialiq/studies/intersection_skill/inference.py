"""The demonstrators' angles, inferred from what they do: the E-step of expectation-maximisation.

The absolute angle is a gauge (learners/competence/angles.py), and the conventions that fix it are
the same: directions have length 1, and what they share is taken for 0 at first, so that the angles
explain what they can. Then a dial is trained with these angles, and they are inferred once more
with what it found; the dial is not trained again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from scipy.special import log_softmax

from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.experiments.intersection.demonstration_sets import DEMONSTRATIONS
from socialiq.experiments.jobs import ProgressCallback
from socialiq.nn.dial_policy import DialPolicy
from socialiq.storage import write_json
from socialiq.studies.intersection_skill.demonstrations import demonstrations
from socialiq.studies.intersection_skill.driving import DIAL

ANGLES = "angles.json"
TEMPERATURES = (0.03, 0.1, 0.3, 1.0)
"""τ of a demonstrator, of which the likeliest counts: how sharp they are is not known either."""


@dataclass(frozen=True)
class Inference:
    """One E-step by one dial; the other input is the demonstrations."""

    size: int
    seed: int
    grid: int


def infer(
    config: Inference, folder: Path, inputs: Mapping[str, Path], on_progress: ProgressCallback
) -> None:
    """Write the likeliest angle of each demonstrator, and how likely each angle is."""
    shown = demonstrations(inputs[DEMONSTRATIONS], config.size, config.seed)
    (trained,) = (path for name, path in inputs.items() if name != DEMONSTRATIONS)
    family = DialPolicy.load(trained / DIAL)
    angles = np.arange(family.low, family.high + 1e-9, config.grid)
    rows = []
    for number, (mode, true) in enumerate(MODES.items(), start=1):
        one = shown[mode]
        logs = likelihood(family, one.observation, one.action, angles.tolist())
        best = int(logs.argmax())
        rows.append(
            {"mode": mode, "true_angle": true, "angle": float(angles[best])}
            | {"log_likelihood": (logs / one.n_transitions).tolist()}
        )
        on_progress(number / len(MODES))
    write_json(folder / ANGLES, rows)


def likelihood(
    family: DialPolicy,
    observation: Float[np.ndarray, "step feature"],
    action: Int[np.ndarray, " step"],
    angles: Sequence[float],
) -> Float[np.ndarray, " angle"]:
    """Log-likelihood of a demonstrator's actions at each angle, at the temperature that fits best.

    Args:
        family: Whose softmax(Q/τ) at an angle acts as a demonstrator of that angle.
        observation: What the demonstrator saw.
        action: What it did.
        angles: In degrees.
    """
    found, rows = [], np.arange(len(action))
    for angle in angles:
        q = family.at(angle).q_values(observation).astype(np.float64)
        logs = (log_softmax(q / one, axis=1) for one in TEMPERATURES)
        found.append(max(float(one[rows, action].sum()) for one in logs))
    return np.array(found)
