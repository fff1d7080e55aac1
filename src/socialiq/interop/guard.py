"""Runs a command that must not outlive its parent; a program of its own, with the standard library.

    python guard.py LIFELINE COMMAND...

LIFELINE is the reading end of a pipe whose writing end the parent alone holds. When the parent
ends, in whatever way, the system closes it, and this program kills its process group: the command
and all it started that did not leave the group. Otherwise it ends as the command does.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading


def main(lifeline: int, command: list[str]) -> int:
    """Run the command, and watch the pipe meanwhile."""
    os.set_inheritable(lifeline, False)
    threading.Thread(target=_watch, args=(lifeline,), daemon=True).start()
    try:
        child = subprocess.Popen(command)
    except OSError as error:
        print(f"{command[0]}: {error.strerror}", file=sys.stderr)
        return 127
    # The pipes to the parent are the command's now: held here, they would hide that it has ended.
    nothing = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(nothing, stream)
    return child.wait()


def _watch(lifeline: int) -> None:
    while os.read(lifeline, 1):
        pass
    os.killpg(0, signal.SIGKILL)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), sys.argv[2:]))
