"""Files and policies that a word of the command line names, as content of the page."""

from __future__ import annotations

from pathlib import Path

from socialiq.audit.resolve_policy import Trust
from socialiq.demonstrations.files import KIND as DEMONSTRATIONS
from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.storage import kind_of, shipped
from socialiq.view.demonstrations import demonstrations_shown
from socialiq.view.policy import policy_shown
from socialiq.view.shown import Shown

FIRST_ANGLE = 45.0
"""Angle of a dial at the start, degrees."""


def opened(what: str, angle: float | None, trust: Trust) -> Shown:
    """Return a policy or a file as content of the page.

    Args:
        what: Demonstrations' file, or a policy as `audit.resolve_policy` takes it.
        angle: Angle of a dial at the start, degrees; None unless the user gave one.
        trust: Permissions of a policy that is code.

    Raises:
        UserError: If it can't be read, is of another world, or an angle is given that has no use.
    """
    path = shipped(Path(what))
    if path.is_dir():
        raise UserError(f"{one_line(what)} is a folder: name a policy, or demonstrations")
    if kind_of(path) == DEMONSTRATIONS:
        _refuse_angle(angle, what)
        return demonstrations_shown(path)
    shown = policy_shown(what, FIRST_ANGLE if angle is None else angle, trust)
    if "dial" not in shown.data:
        try:
            _refuse_angle(angle, what)
        except UserError:
            shown.close()
            raise
    return shown


def _refuse_angle(angle: float | None, what: str) -> None:
    if angle is not None:
        raise UserError(f"--angle is of a dial, which {one_line(what)} is not: leave it out")
