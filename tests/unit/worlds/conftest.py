from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import pytest

from socialiq.worlds import registry
from socialiq.worlds.enumerate import Table, tabulate


class Played(NamedTuple):
    """What a table says of one transition, for comparison with one played by hand."""

    state: tuple[int, ...]
    env: float
    social: float
    ending: int


def play(table: Table, state: tuple[int, ...], action: int, chance: int = 0) -> Played:
    """Look one transition up in a table with all the world's states."""
    s = table.world.index(state)
    after = table.states[table.mdp.successor[s, action, chance]]
    env, social = (float(reward[s, action]) for reward in table.mdp.rewards)
    return Played(tuple(after.tolist()), env, social, int(table.mdp.ending[s, action, chance]))


@cache
def tabulated(name: str, **options: Any) -> Table:
    return tabulate(registry.make(name, **options))


@pytest.fixture(name="tabulated", scope="session")
def tabulated_fixture() -> Callable[..., Table]:
    return tabulated


@pytest.fixture(name="play", scope="session")
def play_fixture() -> Callable[..., Played]:
    return play


@pytest.fixture(scope="session")
def table5() -> Table:
    return tabulated("crossing5")


@pytest.fixture(scope="session")
def table7() -> Table:
    return tabulated("crossing7")
