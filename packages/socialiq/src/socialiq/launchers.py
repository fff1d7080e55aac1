"""Programs that start a policy's command; on the standard library alone, and never imported.

    python launchers.py guard LIFELINE BYTES COMMAND...

runs a command that must not outlive its parent. LIFELINE is the reading end of a pipe whose writing
end only the parent holds. When the parent ends, in whatever way, the system closes the pipe, and
this program kills its process group: the command and every process that it started and that did not
leave the group. Otherwise it ends with the status of the command. BYTES is the address space that
each process of the command may have; 0 sets no limit. The limit is set here, not between fork and
exec of the parent, where a program with threads may not run Python.

    python launchers.py enter USER PROCESSES BYTES COMMAND...

is the first program in a sandbox: it sets limits, refuses some calls of the system, and becomes the
command. USER is the number of a user without rights to become, or -1 to stay. PROCESSES is the
largest number of processes and threads of that user, BYTES the largest size of a file.
"""

import os
import signal
import subprocess
import sys
import threading


def guard(lifeline: int, memory: int, command: list[str]) -> int:
    """Run the command and end it when its parent ends.

    Args:
        lifeline: File descriptor of the pipe's reading end.
        memory: Bytes of address space of each process; 0 for no limit.
        command: Words of the command.

    Returns:
        The command's exit status; 126 if the system sets no memory limit, 127 if it can't be
        started.
    """

    def watch() -> None:
        while os.read(lifeline, 1):
            pass
        os.killpg(0, signal.SIGKILL)

    os.set_inheritable(lifeline, False)
    threading.Thread(target=watch, daemon=True).start()
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


def _limit(kind: int, most: int) -> None:
    import resource

    _, hard = resource.getrlimit(kind)
    least = most if hard == resource.RLIM_INFINITY else min(most, hard)
    resource.setrlimit(kind, (least, least))


def enter(user: int, processes: int, size: int, command: list[str]) -> int:
    """Set the limits and run the command in place of this program; return only on failure.

    Args:
        user: Number of the user to become; -1 to stay.
        processes: Largest number of processes and threads of that user.
        size: Largest size of a file, in bytes.
        command: Path of the program, and its arguments.

    Returns:
        127 if the program can't be run.
    """
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
    _refuse_calls()
    try:
        os.execv(command[0], command)
    except OSError as error:
        print(f"{command[0]}: {error.strerror}", file=sys.stderr)
    return 127


_EVERYWHERE = (425, 449, 451, 454, 455, 456)
_REFUSED = {
    "x86_64": (0xC000003E, 72, 202, (73, 221, 248, 249, 250, 253, 294, 300, 327, *_EVERYWHERE)),
    "aarch64": (0xC00000B7, 25, 98, (26, 32, 217, 218, 219, 223, 262, 286, *_EVERYWHERE)),
}
"""Numbers of the architecture, of fcntl, of futex, and of refused calls, by machine: flock,
fadvise64, add_key, request_key, keyctl, inotify_init, inotify_init1, fanotify_init, preadv2,
io_uring_setup, futex_waitv, cachestat, futex_wake, futex_wait, futex_requeue. They tell of other
processes by a file, a keyring or the page cache that both use."""

_LOCKS = (5, 6, 7, 36, 37, 38, 1024, 1025, 1026)
"""Commands of fcntl for locks, leases and notices of a folder."""

_WAITS = tuple(command + clock for clock in (0, 256) for command in (0, 6, 8, 9, 11, 13))
"""Commands of futex that wait for other processes, by a word in memory or in a file that both map.
Without one that waits, one that wakes has no effect and learns nothing. Those within a process have
another number (128 more). C libraries wait so for a thread's end; they then ask over and over."""


def _refuse_calls() -> None:
    """Let refused calls fail with ENOSYS, and waits for other processes with EAGAIN.

    No process can take off this filter (seccomp).
    """
    import ctypes

    architecture, fcntl, futex, refused = _REFUSED[os.uname().machine]
    load = 0x20
    equal = 0x15
    at_least = 0x35
    end = 0x06
    allow = end, 0, 0x7FFF0000
    refuse = end, 0, 0x00050000 | 38
    again = end, 0, 0x00050000 | 11

    def any_of(tests: list[tuple[int, int]], lines_after: int) -> list[tuple[int, int, int]]:
        """Return tests that jump over those that follow, and over `lines_after`, if they hold."""
        last = len(tests) - 1 + lines_after
        return [(code, last - index, value) for index, (code, value) in enumerate(tests)]

    # Each line has a code, the number of lines that it jumps over if it holds, and a value. Fields
    # of a call: its number at byte 0, the architecture at 4, the second argument at 24.
    second = load, 0, 24
    locks = [second, *any_of([(equal, command) for command in _LOCKS], 1), allow, refuse]
    waits = [second, *any_of([(equal, command) for command in _WAITS], 1), allow, again]
    calls = [(equal, 2, fcntl), (equal, 1 + len(locks), futex), allow, *locks, *waits]
    # Numbers of another instruction set of the same architecture are refused too.
    numbers = [(at_least, 0x40000000), *((equal, number) for number in refused)]
    lines = [(load, 0, 4), (equal, 1, architecture), (end, 0, 0x80000000), (load, 0, 0)]
    lines += [*any_of(numbers, 2 + len(locks)), *calls]
    program = b""
    for code, over, value in lines:
        program += code.to_bytes(2, sys.byteorder) + bytes((over, 0))
        program += value.to_bytes(4, sys.byteorder)
    buffer = ctypes.create_string_buffer(program)

    class Filter(ctypes.Structure):
        _fields_ = [("count", ctypes.c_ushort), ("lines", ctypes.c_void_p)]

    system = ctypes.CDLL(None, use_errno=True)
    filtering = Filter(len(lines), ctypes.addressof(buffer))
    if system.prctl(38, 1, 0, 0, 0) or system.prctl(22, 2, ctypes.byref(filtering), 0, 0):
        raise OSError(ctypes.get_errno(), "this system filters no calls")


if __name__ == "__main__":
    if sys.argv[1] == "guard":
        sys.exit(guard(int(sys.argv[2]), int(sys.argv[3]), sys.argv[4:]))
    sys.exit(enter(int(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]), sys.argv[5:]))
