"""Exception for mistakes of the user."""


class UserError(Exception):
    """Mistake that the user can correct. Its text is one line that says how.

    The command line prints the line and exits with `exit_status`. Library callers may catch it.
    """

    exit_status = 2


def one_of(what: str, value: object, known: tuple[str, ...] | list[str]) -> None:
    """Raise an error for a name that is not among the known names.

    Args:
        what: Kind of thing that the name denotes, in the user's words ("world", "target kind").
        value: The name given; of a file, it may be of any type.
        known: The valid names.

    Raises:
        UserError: If `value` is not in `known`; the line lists the valid names.
    """
    if value not in known:
        text = str(value)
        short = text if len(text) <= 80 else f"{text[:79]}…"
        raise UserError(f"unknown {what} '{short}': choose one of {', '.join(known)}")
