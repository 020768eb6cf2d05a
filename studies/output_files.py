"""Files and folders that commands write: an error names the option for another path."""

from pathlib import Path

from common.errors import BadInput, reason_of


def make_folder(folder: Path, option: str) -> None:
    """Make a folder and its parents; raises BadInput that names the option for another one."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(
            f"cannot make the folder {folder}: {reason_of(error)}. Choose another one with {option}"
        ) from None


def require_writable(path: Path, option: str) -> None:
    """Check a file to write before the long work; raises BadInput as `write_text` does."""
    is_new = not path.exists()
    try:
        path.open("a").close()
    except OSError as error:
        raise BadInput(f"cannot write {path}: {reason_of(error)}. Choose another path with {option}") from None
    if is_new:
        path.unlink()


def write_text(path: Path, text: str, option: str) -> Path:
    """Write a file and return its path; raises BadInput that names the option for another path."""
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise BadInput(f"cannot write {path}: {reason_of(error)}. Choose another path with {option}") from None
    return path
