"""The minute of fuzzing in the gate: bad calls. `python -m tests.fuzz --calls` runs them all."""

import pytest
from tests.fuzz.calls import bad_calls
from tests.fuzz.run_calls import report

from socialiq.cli.commands import COMMANDS

EACH = 8
"""Of so many calls one is run here."""


def test_every_command_has_bad_calls():
    calls = bad_calls()
    assert len(calls) == len({*calls}) >= 1500
    for name in COMMANDS:
        start = tuple(name.split())
        assert sum(call.words[: len(start)] == start for call in calls) >= 10, name


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_no_bad_call_ends_in_a_traceback_or_hangs(runner):
    outcomes = [runner.run(call) for call in bad_calls()[::EACH]]
    found = report(outcomes)
    print(found.splitlines()[0])
    assert not [one for one in outcomes if one.fault], found
