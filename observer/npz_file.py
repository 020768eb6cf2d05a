"""Files of named arrays (.npz without pickles), written whole or not at all."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


def write_whole(path: Path, arrays: Mapping[str, NDArray[Any]], *, compressed: bool) -> None:
    """An older file stays until the new one is complete; raises OSError when the disk or the folder refuses."""
    target = path.resolve()
    # In the same folder, as a replacement is atomic only inside one file system.
    unfinished = target.with_name(f".{target.name}.{os.getpid()}.part")
    save = np.savez_compressed if compressed else np.savez
    try:
        with unfinished.open("wb") as file:
            # No allow_pickle=False: numpy 1.26 would store it as an array. What is written here holds no objects.
            save(file, **arrays)  # type: ignore[arg-type]
            file.flush()
            os.fsync(file.fileno())
        unfinished.replace(target)
    finally:
        # Also after Ctrl-C; after success there is nothing left to remove.
        unfinished.unlink(missing_ok=True)


def read_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """All arrays; raises OSError (FileNotFoundError), ValueError, EOFError or BadZipFile for what is no such file."""
    # Opened here: numpy leaves a broken zip open behind it.
    with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
        return {name: file[name] for name in file.files}
