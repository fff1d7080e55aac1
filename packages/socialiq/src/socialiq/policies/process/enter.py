"""First program in a sandbox: it sets limits and becomes the command.

    python enter.py USER PROCESSES BYTES COMMAND...

USER is the number of a user without rights to become, or -1 to stay. PROCESSES is the largest
number of processes and threads of that user, BYTES the largest size of a file. It is a program
on the standard library and never imported.
"""

from __future__ import annotations

import os
import resource
import sys


def main(user: int, processes: int, size: int, command: list[str]) -> int:
    """Set the limits and run the command in place of this program; return only on failure."""
    if user >= 0:
        os.setgroups([])
        os.setresgid(user, user, user)
        os.setresuid(user, user, user)
    # Before Linux 5.14 the limit counts all processes of a user on the machine.
    if user >= 0 or _release() >= (5, 14):
        _limit(resource.RLIMIT_NPROC, processes)
    _limit(resource.RLIMIT_FSIZE, size)
    _limit(resource.RLIMIT_CORE, 0)
    try:
        os.execv(command[0], command)
    except OSError as error:
        print(f"{command[0]}: {error.strerror}", file=sys.stderr)
    return 127


def _limit(kind: int, most: int) -> None:
    _, hard = resource.getrlimit(kind)
    least = most if hard == resource.RLIM_INFINITY else min(most, hard)
    resource.setrlimit(kind, (least, least))


def _release() -> tuple[int, ...]:
    first = os.uname().release.split("-")[0].split(".")[:2]
    return tuple(int(part) for part in first if part.isdigit())


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), sys.argv[4:]))
