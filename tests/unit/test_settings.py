"""Settings laid over configurations by name."""

from dataclasses import dataclass, field

import pytest

from socialiq.errors import UserError
from socialiq.settings import laid_over


@dataclass(frozen=True)
class Endings:
    timeout: str = "zero"
    other: str = "zero"


@dataclass(frozen=True)
class Structure:
    hidden: tuple[int, ...] = (64, 64)
    share: float | None = None
    dial: bool = False
    endings: Endings = field(default_factory=Endings)


@dataclass(frozen=True)
class Numbers:
    rate: float = 0.1
    other: int = 3


def test_each_value_goes_to_the_configuration_that_has_it():
    values = {"hidden": "8,4", "timeout": "cut", "rate": "1e-3", "dial": "true", "share": "none"}
    structure, numbers = laid_over((Structure(share=0.5), Numbers()), values)
    assert structure == Structure((8, 4), None, True, Endings("cut"))
    assert numbers == Numbers(1e-3)


def test_a_name_that_two_have_is_the_plain_one():
    structure, numbers = laid_over((Structure(), Numbers()), {"other": "5", "endings.other": "x"})
    assert (structure.endings.other, numbers.other) == ("x", 5)


@pytest.mark.parametrize(
    ("values", "line"),
    [
        ({"rates": "1"}, "there is no setting rates: choose one of dial, endings.other"),
        ({"rate": "fast"}, "rate must be a number, got 'fast'"),
        ({"hidden": "8,x"}, "hidden must be an integer"),
        ({"dial": "maybe"}, "choose one of true, false"),
    ],
)
def test_a_mistake_is_one_line(values, line):
    with pytest.raises(UserError, match=line):
        laid_over((Structure(), Numbers()), values, hidden=("hidden",))
