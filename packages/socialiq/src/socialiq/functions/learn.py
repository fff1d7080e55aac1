"""`train`: policies and dials from demonstrations and worlds. Importing it loads JAX."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, overload

import numpy as np

from socialiq.cli import commands
from socialiq.cli.output import Policies
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError, one_of, public
from socialiq.functions.call import called, command_of, options_of
from socialiq.learners.iq_learn import train as iq_learn
from socialiq.learners.kernel import Learner, Trained
from socialiq.learners.settings import LearnerConfig
from socialiq.nn.saved import Saved
from socialiq.reading import path_of
from socialiq.worlds.grammar import text_of
from socialiq.worlds.world import World


@overload
def train(learner: LearnerConfig, /, data: Any, *arguments: Any, **options: Any) -> Trained: ...


@overload
def train(
    learner: str | type[Learner],
    /,
    data: str | Path | Demonstrations | Saved | None = None,
    *,
    world: str | World | None = None,
    angle: float | Sequence[float] | None = None,
    seed: int | Sequence[int] = 0,
    out: str | Path | None = None,
    **hyperparameters: Any,
) -> Policies: ...


def train(
    learner: str | type[Learner] | LearnerConfig,
    /,
    data: Any = None,
    *arguments: Any,
    **options: Any,
) -> Policies | Trained:
    """Train policies or a dial, as `socialiq train LEARNER`.

    A config in place of the learner's name selects the lower level, for extensions:
    `train(config, hyperparameters, datasets, ...)` is `learners.iq_learn.train.train`.

    Args:
        learner: Name of the learner, as "iq-learn" or "dial"; FILE.py:NAME or a class of your own.
        data: Demonstrations or their file, where the learner takes them; of improve-dial the dial.
        *arguments: Further arguments of the level below.
        **options: `world`, as text or object; `angle` in degrees and `seed`, one or several, a run
            for each combination; `out`, a folder to make; further options of the command; and
            every hyperparameter of the learner, as `updates=200`.

    Returns:
        The policies or dials, and the numbers that the command prints.

    Raises:
        UserError: If an option is unknown, or learner, data and world don't go together.
    """
    if isinstance(learner, LearnerConfig):
        return public(iq_learn.train, "train")(learner, data, *arguments, **options)
    names = [name.removeprefix("train ") for name in commands.COMMANDS if name[:6] == "train "]
    if not isinstance(learner, str | type):
        raise TypeError("no learner")
    if isinstance(learner, type) or ":" in learner:
        options["learner"] = learner
        learner = "own"
    one_of("learner", learner, names)
    if arguments:
        raise UserError(f"train {learner} takes options by name: write for instance world=...")
    known = options_of(commands.command_class(f"train {learner}"))
    first = "dial" if "dial" in known else "data"
    if "world" in options:
        options["world"] = text_of(options["world"])
    if data is not None:
        options[first] = data if isinstance(data, Demonstrations | Saved) else path_of(data)
    settings = {name: options.pop(name) for name in [*options] if name not in known}
    options["set"] = (tuple(f"{name}={_text(value)}" for name, value in settings.items()),)
    with called(command_of(f"train {learner}", options)) as command:
        return command.result()


def _text(value: Any) -> str:
    """Return a hyperparameter as `--set` takes it."""
    value = value.tolist() if isinstance(value, np.generic | np.ndarray) else value
    if isinstance(value, tuple | list):
        return json.dumps([_text(item) for item in value])
    return str(value).lower() if isinstance(value, bool) else str(value)
