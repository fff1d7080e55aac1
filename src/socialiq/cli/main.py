"""`socialiq`: parse, run, and turn a user's mistake into one line."""

from __future__ import annotations

import contextlib
import io
import re
import sys
from typing import Annotated, Any, cast

import tyro

from socialiq.cli.audit import Audit
from socialiq.cli.bench import Bench
from socialiq.cli.claims import Claims
from socialiq.cli.collect import Collect
from socialiq.cli.compare import Compare
from socialiq.cli.conformance import Conformance
from socialiq.cli.data import FromArrays, FromMinari, FromTrajectories, ToMinari
from socialiq.cli.demo import Demo
from socialiq.cli.dial import Dial, Turn
from socialiq.cli.evaluate import Evaluate
from socialiq.cli.export import Export
from socialiq.cli.output import complain
from socialiq.cli.predict import PredictLambda
from socialiq.cli.profile import Check, New
from socialiq.cli.recorded import Agreement, TakeCensus, ToDemonstrations
from socialiq.cli.recorded_audit import AuditLog
from socialiq.cli.recordings import Import
from socialiq.cli.render import Render
from socialiq.cli.solve import Front, Solve
from socialiq.cli.studies import Reproduce
from socialiq.cli.train import Train
from socialiq.cli.train_dial import TrainDial
from socialiq.cli.verify import Verify
from socialiq.errors import UserError
from socialiq.learners.callbacks import Stopped

_name = tyro.conf.subcommand
Command = (
    Annotated[Demo, _name("demo")]
    | Annotated[Solve, _name("solve")]
    | Annotated[Front, _name("front")]
    | Annotated[PredictLambda, _name("predict-lambda")]
    | Annotated[Render, _name("render")]
    | Annotated[Collect, _name("collect")]
    | Annotated[FromArrays, _name("data-from-arrays")]
    | Annotated[FromTrajectories, _name("data-from-trajectories")]
    | Annotated[FromMinari, _name("data-from-minari")]
    | Annotated[ToMinari, _name("data-to-minari")]
    | Annotated[Train, _name("train")]
    | Annotated[TrainDial, _name("train-dial")]
    | Annotated[Dial, _name("dial")]
    | Annotated[Turn, _name("turn")]
    | Annotated[Evaluate, _name("evaluate")]
    | Annotated[Export, _name("export")]
    | Annotated[Reproduce, _name("reproduce")]
    | Annotated[Compare, _name("compare")]
    | Annotated[Claims, _name("claims")]
    | Annotated[Conformance, _name("conformance")]
    | Annotated[Bench, _name("bench")]
    | Annotated[New, _name("profile-new")]
    | Annotated[Check, _name("profile-check")]
    | Annotated[Audit, _name("audit")]
    | Annotated[Verify, _name("audit-verify")]
    | Annotated[Import, _name("data-import")]
    | Annotated[ToDemonstrations, _name("data-demonstrations")]
    | Annotated[TakeCensus, _name("data-census")]
    | Annotated[Agreement, _name("data-agreement")]
    | Annotated[AuditLog, _name("data-audit")]
)

TWO_WORDS = (
    ("profile", "new"),
    ("profile", "check"),
    ("audit", "verify"),
    ("data", "from-arrays"),
    ("data", "from-trajectories"),
    ("data", "from-minari"),
    ("data", "to-minari"),
    ("data", "import"),
    ("data", "demonstrations"),
    ("data", "census"),
    ("data", "agreement"),
    ("data", "audit"),
)
"""Commands of two words; the parser knows them joined by a hyphen."""

DESCRIPTION = (
    "Driving policies of a declared social angle, learned from mixed demonstrations. "
    "Exit status: 0 done, 1 a check failed, 2 a mistake in the call, 3 an audit that decides "
    "nothing, 130 stopped by Ctrl-C."
)

_BOX = re.compile(r"[│╭╮╰╯─]+")


def main(arguments: list[str] | None = None) -> int:
    """Run one command.

    Args:
        arguments: What follows the program's name; by default the process's own.

    Returns:
        The exit status.
    """
    try:
        return parse(arguments).run()
    except Stopped as stopped:
        return _fail(str(stopped), 130)
    except KeyboardInterrupt:
        return _fail("stopped; nothing was saved", 130)
    except UserError as error:
        return _fail(str(error), 2)
    except BrokenPipeError:
        return 0


def parse(arguments: list[str] | None) -> Command:
    """Make the command's object; tyro's boxed complaints become one line.

    Raises:
        UserError: If the command line can't be understood.
        SystemExit: After `--help`.
    """
    complaint = io.StringIO()
    try:
        with contextlib.redirect_stderr(complaint):
            return tyro.cli(
                cast(Any, Command),
                prog="socialiq",
                description=DESCRIPTION,
                args=joined(sys.argv[1:] if arguments is None else arguments),
                config=(tyro.conf.FlagCreatePairsOff, tyro.conf.OmitSubcommandPrefixes),
            )
    except SystemExit as stop:
        if not stop.code:
            raise
        raise UserError(one_line(complaint.getvalue())) from stop


def joined(arguments: list[str]) -> list[str]:
    """Make one word of the first two, where they are one command."""
    if tuple(arguments[:2]) in TWO_WORDS:
        return ["-".join(arguments[:2]), *arguments[2:]]
    return arguments


def one_line(boxed: str) -> str:
    """Flatten a boxed message."""
    lines = [_BOX.sub(" ", line).strip() for line in boxed.splitlines()]
    return re.sub(r"\s+", " ", "; ".join(line.rstrip(":") for line in lines if line))


def _fail(line: str, status: int) -> int:
    complain(line)
    return status
