"""Exception for mistakes of the user."""


class UserError(Exception):
    """Mistake that the user can correct. Its text is one line that says how.

    The command line prints the line and exits with `exit_status`. Library callers may catch it.
    """

    exit_status = 2


def one_of(what: str, value: object, allowed: tuple[str, ...] | list[str]) -> None:
    """Raise an error, which lists the known names, for a value that is none of them.

    `what` is the kind of thing that the name denotes, in the user's words ("world", "target kind").
    """
    if value not in allowed:
        text = str(value)
        short = text if len(text) <= 80 else f"{text[:79]}…"
        raise UserError(f"unknown {what} '{short}': choose one of {', '.join(allowed)}")
