"""The command that repeats an audit."""

import dataclasses
from pathlib import Path

from socialiq.audit.request import Request, Trust, command_of
from socialiq.policies.process import GIB, Limits


def test_the_command_names_what_was_not_usual():
    plain = Request("atlas:prosocial", Path("a profile.toml"), 50)
    start = "socialiq audit atlas:prosocial --profile 'a profile.toml' --episodes 50 --seed 7"
    assert command_of(plain, 7) == start
    assert command_of(dataclasses.replace(plain, log=Path("log")), 7) == start
    slow = Trust(limits=Limits(step=12.5, memory=GIB // 2))
    asked = Request("atlas:prosocial", Path("a profile.toml"), 50, shift=True, trust=slow)
    assert command_of(asked, 7) == f"{start} --shift --step-seconds 12.5 --memory-gib 0.5"
