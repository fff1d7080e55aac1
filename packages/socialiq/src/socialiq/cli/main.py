"""`socialiq`: find the command, parse its options, run it, and print mistakes as one line.

Standard output and error never decide the exit status, which is the verdict of `audit`: a reader
that closes the pipe early, a full disk or a locale that lacks a character must not change it.
"""

import _thread
import contextlib
import errno
import importlib.metadata
import io
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from socialiq import foreign
from socialiq.cli import commands, words
from socialiq.errors import UserError

CRASHED = 70
"""Exit status of a fault of the program (EX_SOFTWARE of sysexits.h)."""
OUTPUT_LOST = 74
"""Exit status of a command that did its work but could not write its output (EX_IOERR)."""

_LONGEST_LINE = 1000
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)


def main(arguments: list[str] | None = None) -> int:
    """Run one command, by default of the process's own words; return the exit status."""
    return exit_status(lambda: _run(arguments))


def _run(arguments: list[str] | None) -> int:
    try:
        with ctrl_c_until_heard():
            command = parse(arguments)
            with checked(command):
                status = command.run()
            words.say_old_world(getattr(command, "world", None))
            return status
    except KeyboardInterrupt:
        return _fail("stopped; nothing was saved", 130)
    except UserError as error:
        return _fail(str(error), error.exit_status)
    except MemoryError:
        return _fail("not enough memory: ask for less at a time")
    except OSError as error:
        if error.errno in _NO_ROOM:
            return _fail(f"cannot write: {error.strerror}; make room, or choose another place")
        if error.filename is None:
            raise
        return _fail(f"{error.strerror}: {foreign.cut(str(error.filename), 200)}")


@contextlib.contextmanager
def checked(command: Any) -> Iterator[None]:
    """Check the numbers and places of a command, and keep others from its output in the block.

    The folders above the output are made before the work.
    """
    from socialiq.outputs import check_place, claimed, folder_above

    words.check_options(command)
    for option in ("out", "work"):
        place = getattr(command, option, None)
        if isinstance(place, Path):
            check_place(place, f"--{option}")
    out = getattr(command, "output", getattr(command, "out", None))
    if not isinstance(out, Path):
        yield
        return
    with claimed(out), folder_above(out):
        yield


@contextlib.contextmanager
def ctrl_c_until_heard() -> Iterator[None]:
    """Raise `KeyboardInterrupt` again if a library drops it, until the block has ended.

    JAX has bare `except:` clauses, and Python drops what a callback of its collector raises.
    """
    before = signal.getsignal(signal.SIGINT)
    main_thread = threading.main_thread()
    if threading.current_thread() is not main_thread or before is not signal.default_int_handler:
        yield
        return
    ended = threading.Event()

    def watch() -> None:
        while not ended.wait(1.0):
            handled: Any = sys._current_exceptions().get(main_thread.ident or 0)
            error = handled[1] if isinstance(handled, tuple) else handled  # a tuple up to 3.11
            while error is not None and not isinstance(error, KeyboardInterrupt):
                error = error.__context__
            if error is None:
                _thread.interrupt_main()

    def interrupt(_number: int, _frame: Any) -> None:
        if not watcher.is_alive():
            watcher.start()
        raise KeyboardInterrupt

    def report(dropped: Any) -> None:
        if dropped.exc_type is not KeyboardInterrupt:
            reported(dropped)

    watcher = threading.Thread(target=watch, daemon=True)
    reported = sys.unraisablehook
    sys.unraisablehook = report
    signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    finally:
        ended.set()
        signal.signal(signal.SIGINT, before)
        sys.unraisablehook = reported


def _fail(line: str, status: int = UserError.exit_status) -> int:
    sys.stderr.write(f"socialiq: {foreign.one_line(line, _LONGEST_LINE)}\n")
    return status


def parse(arguments: list[str] | None) -> Any:
    """Return the command's object, with its options.

    Raises:
        UserError: If the command line can't be understood.
        SystemExit: After a help page or the version.
    """
    every = sys.argv[1:] if arguments is None else arguments
    words.check_words(every)
    line = words.forwarded([word for word in every if word != "--json"])
    first = line[0] if line else ""
    if first in ("-h", "--help"):
        _print_and_exit(commands.help_page())
    if first == "--version":
        _print_and_exit(f"socialiq {importlib.metadata.version('socialiq')}\n")
    for length in (2, 1):
        name = " ".join(line[:length])
        if name not in commands.COMMANDS:
            continue
        program = f"socialiq {name}"
        after = line[length:]
        options = commands.declared_options(*commands.COMMANDS[name].split(":"))
        # Before the command's module is imported, which takes seconds.
        if options and (mistake := words.unknown_option(program, after, options)):
            raise mistake
        kind = commands.command_class(name)
        words.refuse_twice(after, kind)
        from socialiq.cli.parser import options_of  # its import takes a tenth of a second

        command = options_of(kind, program, after)
        if "--json" in every:
            if not hasattr(command, "json"):
                raise UserError(f"socialiq {name} prints no result: leave --json out")
            object.__setattr__(command, "json", True)
        return command
    if first in commands.GROUPS and line[1:2] in (["-h"], ["--help"]):
        _print_and_exit(commands.help_page(first))
    raise words.unknown_command(line)


def _print_and_exit(text: str) -> None:
    sys.stdout.write(text)
    raise SystemExit(0)


class Stream:
    """Text stream that remembers the first failed write, `failure`, and ignores what follows it."""

    def __init__(self, stream: Any) -> None:
        """Wrap a stream; None stands for one that was closed before the program began."""
        self._stream = stream
        self.failure: OSError | None = None
        if stream is None:
            self._stream = io.StringIO()
            self.failure = BrokenPipeError()
        elif hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")

    def write(self, text: str) -> int:
        """Write, unless a write has failed."""
        self._try(lambda: self._stream.write(text))
        return len(text)

    def flush(self) -> None:
        """Flush, unless a write has failed."""
        self._try(self._stream.flush)

    def _try(self, action: Callable[[], Any]) -> None:
        if self.failure is None:
            try:
                action()
            except OSError as error:
                self.failure = error

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of the stream, such as `isatty`."""
        return getattr(self._stream, name)


def exit_status(command: Callable[[], int]) -> int:
    """Run a command; return its exit status, whatever becomes of its output.

    It is 70 after a fault of the program, and 74 in the place of 0 if output was lost that a reader
    still waits for, because a disk is full, for instance.
    """
    before = sys.stdout, sys.stderr
    out = Stream(sys.stdout)
    errors = Stream(sys.stderr)
    sys.stdout = out  # pyright: ignore[reportAttributeAccessIssue]
    sys.stderr = errors  # pyright: ignore[reportAttributeAccessIssue]
    try:
        try:
            status = command()
        except Exception:  # a fault of ours, whatever it is, must not look like a failed audit
            traceback.print_exc()
            errors.write(
                "socialiq: this is a fault of the program: please report the lines above\n"
            )
            status = CRASHED
        out.flush()
        if out.failure is not None and out.failure.errno not in (None, errno.EPIPE):
            errors.write(f"socialiq: can't write the output: {out.failure.strerror}\n")
            status = status or OUTPUT_LOST
    finally:
        sys.stdout, sys.stderr = before
        for stream in (out, errors):
            stream.flush()
            # Empty the buffer of a failed stream; Python would exit with 120 at its last flush.
            with contextlib.suppress(AttributeError, OSError, ValueError):
                if stream.failure is not None:
                    null = os.open(os.devnull, os.O_WRONLY)
                    os.dup2(null, stream.fileno())
                    os.close(null)
    return status
