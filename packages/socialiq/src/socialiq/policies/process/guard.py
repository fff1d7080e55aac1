"""Run a command that must not outlive its parent: a separate program on the standard library.

    python guard.py LIFELINE BYTES COMMAND...

LIFELINE is the reading end of a pipe whose writing end only the parent holds. When the parent ends,
in whatever way, the system closes the pipe, and this program kills its process group: the command
and every process that it started and that did not leave the group. Otherwise this program ends with
the status of the command.

BYTES is the address space that each process of the command may have; 0 sets no limit. The limit is
set here, not between fork and exec of the parent, where a program with threads may not run Python.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading


def main(lifeline: int, memory: int, command: list[str]) -> int:
    """Run the command and watch the pipe; return the command's exit status."""
    os.set_inheritable(lifeline, False)
    threading.Thread(target=_watch, args=(lifeline,), daemon=True).start()
    try:
        limit(memory)
    except (ImportError, AttributeError, OSError, ValueError):  # not on every system
        print("this system sets no memory limit: pass --memory-gib 0", file=sys.stderr)
        return 126
    try:
        child = subprocess.Popen(command)
    except OSError as error:
        print(f"{command[0]}: {error.strerror}", file=sys.stderr)
        return 127
    # Open pipes here would hide from the parent that the command has ended.
    nothing = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(nothing, stream)
    return child.wait()


def limit(memory: int) -> None:
    """Bound the address space of this process and of those that it starts."""
    if memory:
        import resource

        _, most = resource.getrlimit(resource.RLIMIT_AS)
        least = memory if most == resource.RLIM_INFINITY else min(memory, most)
        resource.setrlimit(resource.RLIMIT_AS, (least, least))


def _watch(lifeline: int) -> None:
    while os.read(lifeline, 1):
        pass
    os.killpg(0, signal.SIGKILL)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3:]))
