"""Text of strangers, made fit to stand in one line of ours."""

from socialiq.foreign import one_line

__all__ = ["one_line"]
