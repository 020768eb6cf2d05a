"""Errors that people read: one line that names the value, the rule and the way out. Pure."""

import errno
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

WRITE_ERRORS = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO})
NO_MEMORY = ("failed to map segment", "cannot allocate memory", "can't start new thread")
"""The words of the loader, the system and Python for too little memory."""


class LabanmeshError(Exception):
    """A failure at run time; the message is one readable line. The command line exits with status 1."""

    exit_status = 1


class BadInput(LabanmeshError):  # noqa: N818 - it names whose fault it is, which a suffix would not
    """Input from a person or a file is unusable; nothing was changed. The command line exits with status 2."""

    exit_status = 2


class Faults(BadInput):
    """Several faults of one input, a line each. The message is the first, with how many more there are.

    faults: at least one. where_all: the command that lists all; "" where none does.
    """

    def __init__(self, faults: Sequence[str], where_all: str = "") -> None:
        more = f" ({len(faults) - 1} more{f': {where_all}' * bool(where_all)})" if len(faults) > 1 else ""
        super().__init__(faults[0] + more)
        self.faults = tuple(faults)


@contextmanager
def noting(faults: list[str]) -> Iterator[None]:
    """Adds a BadInput of the block to `faults`, so that further checks can run."""
    try:
        yield
    except BadInput as error:
        faults.append(str(error))


def reason_of(error: OSError) -> str:
    """The operating system's reason in lower case: `permission denied`."""
    return (error.strerror or str(error)).lower()


def machine_fault(error: BaseException) -> str:
    """One line for an error by which the machine, not the program, is at fault; "" for any other."""
    number = error.errno if isinstance(error, OSError) else None
    if number in (errno.EMFILE, errno.ENFILE):
        return "too many open files; raise the limit, as with ulimit -n 4096"
    if (
        isinstance(error, MemoryError)
        or number == errno.ENOMEM
        or any(each in str(error).lower() for each in NO_MEMORY)
    ):
        return "out of memory; end other programs, or raise the limit of this one, as with ulimit -v unlimited"
    if isinstance(error, OSError) and number in WRITE_ERRORS and error.filename is None:
        return f"cannot write the output: {reason_of(error)}. Make room, or redirect it elsewhere"
    if type(error).__name__ == "PanicException":
        return f"Zenoh cannot work here: {error}; are memory, threads or open files limited (ulimit -a)?"
    return ""


def with_scene_file(message: str, words: Sequence[str]) -> str:
    """The message with the scene file of the command line for SCENE, so that the command in it can be copied."""
    import re
    import shlex

    file = next((word for word in words if word.endswith(".toml")), "SCENE")
    return re.sub(r"\b(labanmesh (?:[a-z-]+ )+)SCENE\b", lambda match: match[1] + shlex.quote(file), message)
