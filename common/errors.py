"""Errors that people read: one line that names the value, the rule and the way out. Pure."""

from collections.abc import Sequence


class LabanmeshError(Exception):
    """A failure at run time; the message is one readable line. The command line exits with status 1."""

    exit_status = 1


class BadInput(LabanmeshError):  # noqa: N818 - it names whose fault it is, which a suffix would not
    """Input from a person or a file is unusable; nothing was changed. The command line exits with status 2."""

    exit_status = 2


def reason_of(error: OSError) -> str:
    """The operating system's reason in lower case: `permission denied`."""
    return (error.strerror or str(error)).lower()


def with_scene_file(message: str, words: Sequence[str]) -> str:
    """The message with the scene file of the command line for SCENE, so that the command in it can be copied."""
    import re
    import shlex

    file = next((word for word in words if word.endswith(".toml")), "SCENE")
    return re.sub(r"\b(labanmesh (?:[a-z-]+ )+)SCENE\b", lambda match: match[1] + shlex.quote(file), message)
