"""Last line of a training: its score, that of the best demonstrator and of weighted cloning."""

from typing import Any

import numpy as np

from socialiq.cli.evaluate import Evaluate
from socialiq.cli.evaluate_data import chances_of
from socialiq.cli.output import Policies, as_function
from socialiq.demonstrations import files
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.evaluation.measures import compared
from socialiq.evaluation.off_policy import Logged, estimated
from socialiq.learners import behaviour_cloning as bc
from socialiq.nn.dial_policy import Dial
from socialiq.social.angle import exact_weights, score
from socialiq.worlds.catalogue import GRIDS, base

EPISODES = 100
"""Episodes of a policy, where it is not exact."""
SEED = 1_000_000
"""Seed of the first episode, apart from those of demonstrations."""
LEAST_UPDATES = 500
"""Gradient steps below which a training is a trial that is not compared."""
CLONING_UPDATES = 2000
MIDDLE = 45.0
"""Degrees; of several angles the nearest one is compared."""


def comparison(command: Any, outcome: Policies) -> str:
    """Return a line that compares a training with its demonstrations.

    Args:
        command: The command that trained: its `data`, `world`, `allow_code` and `size`, if it has
            them.
        outcome: Its outcome.

    Returns:
        The line, with the reason where a score can't be computed; "" for a training without
        demonstrations, without an angle or with failures.
    """
    path = getattr(command, "data", None)
    policy, angle = _middle(outcome)
    updates = command.size.updates if path else None
    if path is None or policy is None or outcome.failures:
        return ""
    if updates is not None and updates < LEAST_UPDATES:
        return f"no score: --updates {updates} are fewer than {LEAST_UPDATES}"
    try:
        data = files.load(path, continuous=True)
        return _scores(command, policy, angle, data)
    except UserError as error:
        return f"no score at {angle:g} degrees: {error}"


def _middle(outcome: Policies) -> tuple[Any, float]:
    """Return the policy whose angle is nearest to `MIDDLE`, and its angle; None for none."""
    if outcome.trained and isinstance(dial := outcome.trained[0], Dial):
        angle = float(np.clip(MIDDLE, dial.low, dial.high))
        return dial.at(angle), angle
    rows = zip(outcome.trained, outcome.table, strict=False)
    policies = [(policy, row["angle"]) for policy, row in rows if row.get("angle") is not None]
    return min(policies, key=lambda pair: abs(pair[1] - MIDDLE), default=(None, MIDDLE))


def _scores(command: Any, policy: Any, angle: float, data: Demonstrations) -> str:
    """Return the line, with the scores of policy, best demonstrator and weighted clone."""
    weights = exact_weights(angle)
    of_episode = score(weights, data.totals())
    by_mode = {
        data.mode_names[mode]: of_episode[data.episode_modes == mode].mean()
        for mode in np.unique(data.episode_modes)
    }
    best = max(by_mode, key=lambda name: by_mode[name])
    world = getattr(command, "world", "")
    if data.action_size and not world:
        raise UserError("continuous actions are evaluated in a world: add --world")
    learner = bc.GaussianCloning if data.action_size else bc.BehaviourCloning
    static = bc.CloningConfig(weighted=True, updates=CLONING_UPDATES)
    clone = learner.train_on(static, [bc.CloningHyperparameters(angle=angle)], [data]).policy(0)
    if world:
        episodes = 0 if base(world) in GRIDS else EPISODES
        how = {"angle": angle, "episodes": episodes, "seed": SEED}
        code = getattr(command, "allow_code", False)
        with as_function():
            measured = Evaluate(world=world, allow_code=code, **how).measured([policy, clone])
        ours, cloned = (row["score"] for row in compared([each.totals for each in measured], angle))
        where = f"{episodes} episodes of {world}" if episodes else f"exactly in {world}"
    else:
        logged = Logged.of(data)
        estimates = [
            estimated(logged, chances_of(each, data.n_actions)) for each in (policy, clone)
        ]
        ours, cloned = (float(score(weights, totals)) for totals in estimates)
        where = f"fitted Q evaluation of {command.data}"
    return (
        f"score at {angle:g} degrees ({where}): trained {ours:.3g}, best demonstrator ({best}) "
        f"{by_mode[best]:.3g}, weighted cloning {cloned:.3g}"
    )
