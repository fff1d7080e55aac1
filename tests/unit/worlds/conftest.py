from typing import NamedTuple

import pytest

from socialiq.worlds.enumerate import Table


class Played(NamedTuple):
    """One transition of a table, for comparison with a simulated transition."""

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


@pytest.fixture(name="play", scope="session")
def play_fixture():
    return play
