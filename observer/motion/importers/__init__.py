"""Importers of other people's recordings, one file each, found by name."""

from difflib import get_close_matches
from pathlib import Path

from common.errors import BadInput
from observer.motion.archive import check_archive
from observer.motion.importers import bvh, csv_table, florence3d, msr_action3d
from observer.motion.importers.base import Importer, ImportResult, Progress

__all__ = ["IMPORTERS", "ImportResult", "Importer", "Progress", "import_recordings"]

IMPORTERS: dict[str, Importer] = {
    "msr-action3d": msr_action3d.import_folder,
    "florence3d": florence3d.import_folder,
    "bvh": bvh.import_files,
    "csv": csv_table.import_files,
}
"""KIND of `labanmesh import KIND PATH` -> importer. A new kind is one new file and one line here."""


def import_recordings(kind: str, path: Path, progress: Progress | None = None) -> ImportResult:
    """The recordings of `kind` at `path` (the folder or file that holds them) as one valid archive, with notes.

    progress: called with (done, total) now and then. Raises BadInput for an unknown kind and for every defect of
    the files, one line with the file, the place in it and what was expected.
    """
    if kind not in IMPORTERS:
        near = get_close_matches(kind.lower(), IMPORTERS, 1, 0.5)
        hint = f"did you mean {near[0]}? " if near else ""
        raise BadInput(f"kind {kind!r}: unknown; {hint}known: {', '.join(IMPORTERS)}")
    result = IMPORTERS[kind](path, progress)
    check_archive(result.archive, str(path))
    return result
