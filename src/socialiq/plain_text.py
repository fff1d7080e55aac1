"""Text of strangers, made fit to stand in one line of ours."""

from __future__ import annotations


def one_line(text: str | bytes, most: int = 200) -> str:
    """Printable characters only, one line, cut to a length.

    Escape sequences could rewrite a terminal, and characters that change the reading direction
    could make a line say something else; neither is printable in Python's sense.

    Args:
        text: What a file, a program or a library says.
        most: Characters that are kept.
    """
    decoded = text.decode("utf-8", "replace") if isinstance(text, bytes) else text
    plain = "".join(one if one.isprintable() else " " for one in decoded[: 20 * most])
    line = " ".join(plain.split())
    return line if len(line) <= most else line[: most - 1] + "…"
