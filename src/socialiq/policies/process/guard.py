"""Runs a command that must not outlive its parent; a program of its own, with the standard library.

    python guard.py LIFELINE BYTES COMMAND...

LIFELINE is the reading end of a pipe whose writing end the parent alone holds. When the parent
ends, in whatever way, the system closes it, and this program kills its process group: the command
and all it started that did not leave the group. Otherwise it ends as the command does.

BYTES is how much address space each process of the command may have; 0 sets no limit. The limit is
set here, not between fork and exec of the parent, where a program with threads may not run Python.
"""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import threading


def main(lifeline: int, memory: int, command: list[str]) -> int:
    """Run the command, and watch the pipe meanwhile."""
    os.set_inheritable(lifeline, False)
    threading.Thread(target=_watch, args=(lifeline,), daemon=True).start()
    try:
        limit(memory)
    except (OSError, ValueError):
        print("this system sets no memory limit: allow any amount", file=sys.stderr)
        return 126
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


def limit(memory: int) -> None:
    """Bound the address space of this process and of those that it starts, for good."""
    if memory:
        _, most = resource.getrlimit(resource.RLIMIT_AS)
        least = memory if most == resource.RLIM_INFINITY else min(memory, most)
        resource.setrlimit(resource.RLIMIT_AS, (least, least))


def _watch(lifeline: int) -> None:
    while os.read(lifeline, 1):
        pass
    os.killpg(0, signal.SIGKILL)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3:]))
