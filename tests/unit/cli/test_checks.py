"""Values that no option may have, checked for all commands in one place."""

import dataclasses

import pytest

from socialiq.cli.words import check_options, check_words, refuse_unused
from socialiq.errors import UserError


@dataclasses.dataclass(frozen=True)
class Below:
    rate: float = 0.5


@dataclasses.dataclass(frozen=True)
class Command:
    episodes: int = 1
    seed: int = 0
    seeds: tuple[int, ...] = (0,)
    weights: tuple[float, ...] = ()
    share: float = 0.5
    angle: float | None = None
    name: str = ""
    flag: bool = False
    below: Below = dataclasses.field(default_factory=Below)


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ([""], "an empty word"),
        (["claims", "--verdict", ""], "an empty word of --verdict"),
        (["claims", "--verdict="], "--verdict is empty"),
        (["evaluate", "caf\udce9"], "'caf?' is not UTF-8"),
        (["evaluate", "a\0b"], "zero byte"),
    ],
)
def test_words_that_are_no_values(words, line):
    with pytest.raises(UserError) as caught:
        check_words(words)
    assert line in str(caught.value) and "\n" not in str(caught.value)


def test_other_words_are_the_commands():
    check_words(["audit", "process:sh -c 'a\nb'", "--owner", "é", "--x=a=b", "-", "--"])


@pytest.mark.parametrize(
    ("changed", "line"),
    [
        ({"episodes": 10**24}, "--episodes a number of 25 digits: give at most 1,000,000,000"),
        ({"episodes": -(10**10)}, "give at most"),
        ({"seed": -1}, "--seed: seed must be at least 0, got -1"),
        ({"seed": 2**63}, "below 2^63"),
        ({"seeds": (1, -2)}, "--seeds: seed must be at least 0, got -2"),
        ({"seeds": ()}, "--seeds has no value"),
        ({"share": float("nan")}, "--share nan: give 0, or a number"),
        ({"share": float("inf")}, "--share inf"),
        ({"share": 1e-320}, "--share 9.99989e-321"),
        ({"angle": float("-inf")}, "--angle -inf"),
        ({"weights": (1.0, float("nan"))}, "--weights nan"),
        ({"below": Below(float("nan"))}, "--rate nan"),
    ],
)
def test_numbers_that_no_run_could_take(changed, line):
    with pytest.raises(UserError) as caught:
        check_options(Command(**changed))
    assert line in str(caught.value)


def test_numbers_that_commands_judge():
    check_options(Command(-5, 2**63 - 1, (0, 1), (), -1e99, 0.0, "", True))


def test_options_without_use_are_refused():
    refuse_unused(Command(), ("share", "name"), "--mixture x")
    with pytest.raises(UserError, match="--share is of --mixture x: add that"):
        refuse_unused(Command(share=0.1), ("name", "share"), "--mixture x")
