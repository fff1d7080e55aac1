"""Files and policies that a word of the command line names, as views of the page.

Another distribution adds its files by entry points of the group `socialiq.views`: the name is a
kind of file (`storage.kind_of`) or the end of a file's name, the object a function from its path to
a `View`.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import EntryPoint
from pathlib import Path

from socialiq.audit.resolve_policy import Trust
from socialiq.demonstrations.files import KIND as DEMONSTRATIONS
from socialiq.errors import UserError
from socialiq.foreign import one_line
from socialiq.storage import kind_of, shipped
from socialiq.view import View
from socialiq.view.audit import audit_view
from socialiq.view.demonstrations import demonstrations_view
from socialiq.view.policy import policy_view
from socialiq.worlds.registry import installed, loaded

FIRST_ANGLE = 45.0
"""Angle of a dial at the start, degrees."""

GROUP = "socialiq.views"
_RECORDINGS = ("recording", ".xml")
_OF_RECORDINGS = "socialiq_recordings.view:recording_view"


def opened(what: str, angle: float | None, trust: Trust) -> View:
    """Return a policy or a file as content of the page.

    Args:
        what: Folder of an audit, file of demonstrations or of recorded traffic, or a policy as
            `audit.resolve_policy` takes it.
        angle: Angle of a dial at the start, degrees; None unless the user gave one.
        trust: Permissions of a policy that is code.

    Raises:
        UserError: If it can't be read, is of another world, or an angle is given that has no use.
    """
    path = shipped(Path(what))
    show = _readers(path)
    if show is not None:
        _refuse_angle(angle, what)
        return show(path)
    view = policy_view(what, FIRST_ANGLE if angle is None else angle, trust)
    if "dial" not in view.data:
        try:
            _refuse_angle(angle, what)
        except UserError:
            view.close()
            raise
    return view


def _readers(path: Path) -> Callable[[Path], View] | None:
    """Return the reader of a folder or a file that is no policy; None for all else.

    Raises:
        UserError: If it is recorded traffic of a format that needs to be imported first.
    """
    if path.is_dir():
        return audit_view
    kind, suffix = kind_of(path), path.suffix.lower()
    if suffix in (".csv", ".parquet", ".osm") and path.is_file():
        raise UserError(
            f"{one_line(str(path))}: import recorded traffic first, by `socialiq data import`, "
            "and name the file that it makes"
        )
    if kind == DEMONSTRATIONS:
        return demonstrations_view
    readers = {name: EntryPoint(name, _OF_RECORDINGS, GROUP) for name in _RECORDINGS}
    readers |= installed(GROUP)
    reader = readers.get(kind) or readers.get(suffix)
    return None if reader is None else loaded(reader, one_line(str(path)))


def _refuse_angle(angle: float | None, what: str) -> None:
    if angle is not None:
        raise UserError(f"--angle is of a dial, which {one_line(what)} is not: leave it out")
