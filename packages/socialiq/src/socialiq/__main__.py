"""`python -m socialiq`, and the command `socialiq`."""

import sys

STOPPED = 130
"""Exit status after Ctrl-C."""


def main() -> int:
    """Run one command; the imports before it take a second, in which Ctrl-C ends them too."""
    try:
        from socialiq.cli.main import main as run
    except KeyboardInterrupt:
        sys.stderr.write("socialiq: stopped; nothing was saved\n")
        return STOPPED
    return run()


if __name__ == "__main__":
    sys.exit(main())
