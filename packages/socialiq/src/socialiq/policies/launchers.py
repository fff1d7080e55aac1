"""Programs that start a policy's command; on the standard library alone, and never imported.

    python launchers.py guard LIFELINE BYTES COMMAND...

runs a command that must not outlive its parent. LIFELINE is the reading end of a pipe whose writing
end only the parent holds. When the parent ends, in whatever way, the system closes the pipe, and
this program kills its process group: the command and every process that it started and that did not
leave the group. Otherwise it ends with the status of the command. BYTES is the address space that
each process of the command may have; 0 sets no limit. The limit is set here, not between fork and
exec of the parent, where a program with threads may not run Python.

    python launchers.py enter USER PROCESSES BYTES COMMAND...

is the first program in a sandbox: it sets limits and becomes the command. USER is the number of a
user without rights to become, or -1 to stay. PROCESSES is the largest number of processes and
threads of that user, BYTES the largest size of a file.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading


def guard(lifeline: int, memory: int, command: list[str]) -> int:
    """Run the command and watch the pipe; return the command's exit status."""
    os.set_inheritable(lifeline, False)
    threading.Thread(target=_watch, args=(lifeline,), daemon=True).start()
    try:
        if memory:
            import resource

            _limit(resource.RLIMIT_AS, memory)
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


def _watch(lifeline: int) -> None:
    while os.read(lifeline, 1):
        pass
    os.killpg(0, signal.SIGKILL)


def _limit(kind: int, most: int) -> None:
    import resource

    _, hard = resource.getrlimit(kind)
    least = most if hard == resource.RLIM_INFINITY else min(most, hard)
    resource.setrlimit(kind, (least, least))


def enter(user: int, processes: int, size: int, command: list[str]) -> int:
    """Set the limits and run the command in place of this program; return only on failure."""
    import resource

    if user >= 0:
        os.setgroups([])
        os.setresgid(user, user, user)
        os.setresuid(user, user, user)
    # Before Linux 5.14 the limit counts all processes of a user on the machine.
    release = os.uname().release.split("-")[0].split(".")[:2]
    if user >= 0 or tuple(int(number) for number in release if number.isdigit()) >= (5, 14):
        _limit(resource.RLIMIT_NPROC, processes)
    _limit(resource.RLIMIT_FSIZE, size)
    _limit(resource.RLIMIT_CORE, 0)
    try:
        os.execv(command[0], command)
    except OSError as error:
        print(f"{command[0]}: {error.strerror}", file=sys.stderr)
    return 127


if __name__ == "__main__":
    if sys.argv[1] == "guard":
        sys.exit(guard(int(sys.argv[2]), int(sys.argv[3]), sys.argv[4:]))
    sys.exit(enter(int(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]), sys.argv[5:]))
