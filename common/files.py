"""Reading small text files of people, and writing files that nobody could make again."""

import os
import re
import resource
import tomllib
from contextlib import suppress
from pathlib import Path
from typing import Any

from common.errors import BadInput, LabanmeshError

TEXT_FILE_BYTES = 16 * 2**20
"""Bytes of a text file: no scene, camera or register is that long, and a device without end is."""

OPEN_FILES = 64
"""A dashboard opens 17 before its first listener; each connection takes one or two."""
LINE_LIMIT = 60
"""Characters of a wrong line that are quoted."""
TOML_RULES = {
    "Invalid value": 'text stands in quotes, KEY = "TEXT"; true and false in small letters',
    "Expected '='": "a line is KEY = VALUE, [SECTION] or # COMMENT",
    "Invalid initial": "a line is KEY = VALUE, [SECTION] or # COMMENT",
    "Invalid statement": "a line is KEY = VALUE, [SECTION] or # COMMENT",
    "Expected newline": "one KEY = VALUE stands on a line, text in quotes; decimals have a point",
    "Illegal character": "the text in quotes has no end; close the quotes",
    'Expected "\'"': "the text in quotes has no end; close the quotes",
    "Unterminated string": "the text in quotes has no end; close the quotes",
    "Unescaped": "a \\ within \"...\" is written \\\\; or use '...'",
    "Invalid hex": "a \\ within \"...\" is written \\\\; or use '...'",
    "Cannot declare": "each [SECTION] stands once; write all its keys below it",
    "Cannot overwrite": "each key stands once; remove one",
    "Cannot mutate": "each key and section stands once; remove one",
    "Duplicate inline": "each key stands once; remove one",
    "Unclosed": "close the bracket, ] or }",
    "Expected ']": "a section is [SECTION]; close the bracket",
    "Invalid date": "text stands in quotes",
}
"""What is right, by how a message of tomllib begins."""


def require_open_files() -> None:
    """Let this process have OPEN_FILES at least; raises LabanmeshError where a hard limit forbids it.

    Libraries end the process, or print a stack, when they cannot open a file.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY or soft >= OPEN_FILES:
        return
    if hard != resource.RLIM_INFINITY and hard < OPEN_FILES:
        raise LabanmeshError(f"{hard} open files are too few; raise the limit, as with ulimit -n 4096")
    resource.setrlimit(resource.RLIMIT_NOFILE, (OPEN_FILES, hard))


def expand_home(name: str) -> Path:
    """The path `name`, with the home folder for `~`; raises BadInput for the home of an unknown user."""
    try:
        return Path(name).expanduser()
    except RuntimeError:
        raise BadInput(f"{name}: no user of this machine has this home folder; write the whole path") from None


def read_text(path: Path, limit: int = TEXT_FILE_BYTES) -> str:
    """The text of the file at `path`, UTF-8, without the mark that some editors put before it.

    Raises OSError, and ValueError, one line, for anything that is no such text, or longer than `limit` bytes.
    """
    # A NUL in a name is a ValueError of its own.
    with path.open("rb") as file:
        content = file.read(limit + 1)
    if len(content) > limit:
        raise ValueError(f"longer than {limit >> 20} MB")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError("not UTF-8 text; name a text file, or save it as UTF-8") from None


def parse_toml(text: str) -> dict[str, Any]:
    """The table in a TOML text; raises ValueError, one line, for anything else."""
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("nested too deeply") from None
    except ValueError as error:
        # Of tomllib itself, or for a number of thousands of digits, or an impossible date.
        raise ValueError(_toml_fault(str(error).partition(";")[0], text)) from None


def _toml_fault(message: str, text: str) -> str:
    """A message of tomllib with the line that it is about, and what would be right."""
    place = re.search(r"\(at line (\d+), column (\d+)\)\Z", message)
    if place:
        # The end of a line counts as the next line's column 0.
        line = text.splitlines()[: int(place[1]) - (place[2] == "0")][-1:]
        # An address may have a password in it, wherever the fault is.
        quoted = re.sub(r"[^\s\"'=]*(://|@).*", "...", "".join(line).strip())[:LINE_LIMIT]
        shown = "".join(letter if letter.isprintable() else "?" for letter in quoted)
        message += f": {shown}"
    rules = [rule for begin, rule in TOML_RULES.items() if message.startswith(begin)]
    return "; ".join([message, *rules])


def read_toml(path: Path) -> dict[str, Any]:
    """The table in the TOML file at `path`; raises OSError, and ValueError, one line, for anything else."""
    return parse_toml(read_text(path))


def replace_file(path: Path, content: bytes | memoryview, mode: int = 0o666) -> None:
    """Write `content` to `path` so that a crash, or a loss of power, leaves the old file or the new one, complete.

    mode: of the new file, less the process's umask. Raises OSError.
    """
    # In the same folder: replacing is atomic only within one file system.
    unfinished = path.with_name(f".{path.name[:200]}.{os.getpid()}.part")
    try:
        with os.fdopen(os.open(unfinished, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, mode), "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        unfinished.replace(path)
        sync_folder(path.parent)
    finally:
        # Also after Ctrl-C; after success there is nothing left to remove.
        unfinished.unlink(missing_ok=True)


def open_private(path: Path) -> int:
    """The descriptor of an empty file that only this user may read, also if others could read it; raises OSError."""
    number = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    with suppress(OSError):
        os.fchmod(number, 0o600)
    return number


def sync_folder(folder: Path) -> None:
    """Write the names in `folder` to the disk: a new or renamed file is found again after a loss of power."""
    number = os.open(folder, os.O_RDONLY)
    try:
        # Some network file systems cannot.
        with suppress(OSError):
            os.fsync(number)
    finally:
        os.close(number)
