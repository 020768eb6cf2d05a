"""Reads and writes files of named arrays (.npz without pickles)."""

from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from observer.file_output import write_file


def write_arrays(path: Path, arrays: Mapping[str, NDArray[Any]], *, compressed: bool) -> None:
    """Write the arrays to `path`; raises BadInput or LabanmeshError as `write_file` does."""
    content = BytesIO()
    save = np.savez_compressed if compressed else np.savez
    # No allow_pickle=False: numpy 1.26 would store it as an array. The arrays contain no objects.
    save(content, **arrays)  # type: ignore[arg-type]
    write_file(path, content.getbuffer())


def read_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """All arrays of a file; raises FileNotFoundError, and ValueError with one line for a file that cannot be read."""
    try:
        # Opened here: numpy leaves a broken zip open.
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except FileNotFoundError:
        raise
    # The errors of zipfile, zlib, tokenize and numpy for broken files have no common base class.
    except Exception as error:
        raise ValueError(" ".join(str(error).split())[:200] or type(error).__name__) from error
