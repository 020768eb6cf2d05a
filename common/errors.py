"""Errors that a person reads: one line that names the value, the rule and the way out."""


class LabanmeshError(Exception):
    """Something went wrong at run time; the message is one readable line. The command line exits with 1."""

    exit_status = 1


class BadInput(LabanmeshError):  # noqa: N818 - it names whose fault it is, which a suffix would not
    """What a person or a file gave cannot be used; nothing was changed. The command line exits with 2."""

    exit_status = 2
