"""Importers of other formats, one file each, by name."""

from pathlib import Path

from common.errors import BadInput
from common.text import nearest
from observer.motion.archive import check_archive
from observer.motion.importers import bvh, csv_table, florence3d, joined, msr_action3d
from observer.motion.importers.base import Importer, ImportResult, Progress

__all__ = ["IMPORTERS", "ImportResult", "Importer", "Progress", "import_recordings"]

IMPORTERS: dict[str, Importer] = {
    "msr-action3d": msr_action3d.import_folder,
    "florence3d": florence3d.import_folder,
    "bvh": bvh.import_files,
    "csv": csv_table.import_files,
    "archive": joined.import_archives,
}
"""KIND of `labanmesh import KIND PATH` -> importer. A new kind is one new file and one line here."""


def import_recordings(kind: str, path: Path, progress: Progress | None = None) -> ImportResult:
    """The recordings at `path`, a folder or file of this kind, as one valid archive, with notes.

    progress: called with (done, total) now and then. Raises BadInput for an unknown kind and for every defect of the
    files, one line with the file, the place in it and what is expected.
    """
    if kind not in IMPORTERS:
        raise BadInput(f"kind {kind!r}: unknown; {nearest(kind.lower(), IMPORTERS)}")
    result = IMPORTERS[kind](path, progress)
    check_archive(result.archive, str(path))
    return result
