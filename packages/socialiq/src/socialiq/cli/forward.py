"""Words of older releases, with the words of this one in their place."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

OLD_WORDS = ("train", "train-dial", "improve-dial", "compare")
"""First words that `forwarded` may change."""
OFFLINE = "offline-regularised"
"""Preset of `train-dial` that is now the learner offline-dial."""


def forwarded(words: Sequence[str], learners: Sequence[str]) -> list[str]:
    """Return a command line in the words of this release; one that changes is printed.

    `train FILE` stands for `train iq-learn FILE`, with `--learner` for that learner; `train-dial
    WORLD` for `train dial --world WORLD`; `improve-dial` for `train improve-dial`; `compare priors`
    for `reproduce compare-priors`.

    Args:
        words: The command line after the program's name.
        learners: Learners of `train`.
    """
    first, options = words[0], list(words[1:])
    if first == "improve-dial":
        new = ["train", "improve-dial", *options]
    elif first == "train-dial":
        new = ["train", *_dial(options)]
    elif first == "compare" and options and not options[0].startswith("-"):
        new = ["reproduce", f"compare-{options[0]}", *options[1:]]
    elif first == "train" and options and _is_bare(options, learners):
        new = ["train", *_learner(options)]
    else:
        return list(words)
    sys.stderr.write(f"socialiq: these words are now: socialiq {' '.join(new[:4])} ...\n")
    return new


def _is_bare(rest: Sequence[str], learners: Sequence[str]) -> bool:
    """Whether the words after `train` are a file or options in the place of a learner."""
    word = rest[0]
    if word in (*learners, "-h", "--help"):
        return False
    return word.startswith("--") or "." in word or "/" in word or Path(word).exists()


def _learner(options: list[str]) -> list[str]:
    """Return the words with the learner of --learner first."""
    learner, options = _without(options, "--learner")
    if ":" in learner:
        return ["own", learner, *options]
    return [learner or "iq-learn", *options]


def _dial(options: list[str]) -> list[str]:
    """Return the words of `train-dial` with the file first and the world as an option."""
    data, options = _without(options, "--data")
    world = [] if not options or options[0].startswith("-") else ["--world", options.pop(0)]
    file, learner = ([data] if data else []), "dial"
    if any(OFFLINE in word for word in options):
        learner, options = "offline-dial", _without(options, "--preset")[1]
    practised, options = _without(options, "--practice")
    if practised:
        learner = "practised-dial"
        new = {"--practice-episodes": "--episodes", "--practice-seed": "--first-seed"}
        options = ["--rounds", practised, *(new.get(word, word) for word in options)]
    return [learner, *file, *world, *options]


def _without(words: list[str], option: str) -> tuple[str, list[str]]:
    """Return the value of an option, "" if it is not given, and the words without it."""
    for position, word in enumerate(words):
        if word.startswith(f"{option}="):
            return word.partition("=")[2], [*words[:position], *words[position + 1 :]]
        if word == option and position + 1 < len(words):
            return words[position + 1], [*words[:position], *words[position + 2 :]]
    return "", words
