"""Options of a road are composed of parts in any combination."""

import itertools

import pytest

from socialiq.worlds.highway.kinds import PARTS, kind_with
from socialiq.worlds.highway.options import RoadOptions
from socialiq.worlds.intersection.generated import GeneratedOptions
from socialiq.worlds.intersection.options import Options

COMBINATIONS = [
    parts for count in range(1, len(PARTS) + 1) for parts in itertools.combinations(PARTS, count)
]


@pytest.mark.parametrize("plain", [RoadOptions, Options, GeneratedOptions])
@pytest.mark.parametrize("parts", COMBINATIONS)
def test_each_part_replaces_what_the_plain_options_say(plain, parts):
    kind = kind_with(plain, parts)
    for part in parts:
        before_plain = kind.__mro__.index(part) < kind.__mro__.index(RoadOptions)
        assert before_plain or issubclass(plain, part)
    kind()
