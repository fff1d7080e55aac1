"""The one exception that a user's mistake raises."""


class UserError(Exception):
    """A mistake that the user can mend; its text is one line that says what to do.

    The command line prints the line and exits with status 2. Library callers may catch it.
    """


def one_of(what: str, value: str, known: tuple[str, ...] | list[str]) -> None:
    """Refuse a name that is not among the known ones.

    Args:
        what: What the name stands for, as the user calls it ("world", "target kind").
        value: The name given.
        known: The names that would do.

    Raises:
        UserError: If `value` is not in `known`; the line lists what is.
    """
    if value not in known:
        raise UserError(f"unknown {what} '{value}': choose one of {', '.join(known)}")
