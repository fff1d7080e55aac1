"""`view`: the page over a local server, for the user's own files."""

from __future__ import annotations

import dataclasses
import webbrowser
from dataclasses import dataclass
from typing import Annotated

import tyro

from socialiq.cli.code_options import CodeOptions
from socialiq.cli.output import say
from socialiq.social.angle import check_angle


@dataclass(frozen=True)
class View:
    """Open the page in a browser for a policy, an audit or data of yours.

    A policy (a file of socialiq, .zip of Stable-Baselines3, .onnx, "process:COMMAND LINE",
    python:MODULE:ATTRIBUTE, atlas:NAME or a rule-based driver) drives beside the dial on the same
    seeds. Demonstrations of the intersection and episodes of an audit are replayed. Recorded
    traffic (CommonRoad, or a file of `socialiq data import`) plays on its lanes, with its
    conflicts. Without a name, it is the page of `socialiq page`.

    The server listens at 127.0.0.1 alone, and answers only whom it gave the address, until Ctrl-C.

    Example: socialiq view policy.onnx
    """

    what: Annotated[str, tyro.conf.Positional] = ""
    """The policy, the folder of an audit, or the file of demonstrations or of recorded traffic."""
    angle: float | None = None
    """Angle in degrees at which a dial begins; by default 45."""
    port: int = 0
    """Port at 127.0.0.1; 0 takes a free one."""
    open: bool = True
    """Print the address instead of opening a browser."""
    code: tyro.conf.OmitArgPrefixes[CodeOptions] = dataclasses.field(default_factory=CodeOptions)

    def run(self) -> int:
        """Serve until Ctrl-C."""
        from socialiq.view.open import opened
        from socialiq.view.server import check_extra, serve

        if self.angle is not None:
            check_angle(self.angle)
        check_extra()
        content = opened(self.what, self.angle, self.code.trust) if self.what else None
        try:
            serve(content, self.port, self._opened)
        finally:
            if content is not None:
                content.close()
        say("stopped")
        return 0

    def _opened(self, address: str) -> None:
        say(f"{address}\nCtrl-C ends it")
        if self.open:
            webbrowser.open(address)
