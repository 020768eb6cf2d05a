"""The command `labanmesh import`."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from common.progress import ProgressBar
from common.text import plural


def import_recordings(
    kind: Annotated[str, typer.Argument(help="msr-action3d, florence3d, bvh, csv or archive.")],
    path: Annotated[Path, typer.Argument(help="The folder or file that holds the recordings.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The motion archive to write (.npz).")],
    seen_from: Annotated[
        str, typer.Option(help="A view, such as door, yaw:30 or a camera file: write the 2-D tracks of a camera there.")
    ] = "",
) -> None:
    """Convert recordings in another format to a motion archive of hands and head, as docs/reference/motion.md says.

    Example: labanmesh import msr-action3d MSRAction3DSkeletonReal3D -o msr.npz

    Example: labanmesh import archive msr.npz --seen-from yaw:30 -o sofa.npz
    """
    from observer.geometry.views import parse_view
    from observer.motion.archive import TracksCamera
    from observer.motion.archive_file import write_archive
    from observer.motion.importers import import_recordings as read
    from observer.motion.projected import projected

    view = parse_view(seen_from) if seen_from else None
    with ProgressBar() as bar:
        result = read(kind, path, progress=lambda done, total: bar("reading", done, total))
    archive = result.archive if view is None else projected(result.archive, view, TracksCamera(output.stem))
    write_archive(output, archive)
    for note in result.notes:
        print(note, file=sys.stderr)
    recordings = archive.recordings
    print(
        f"{output}: {plural(len(recordings), 'recording')}, {plural(len({r.label for r in recordings}), 'movement')}, "
        f"{plural(len({r.subject for r in recordings}), 'person', 'people')}, "
        f"{plural(sum(len(r.positions) for r in recordings), 'frame')} at {recordings[0].rate_hz:g} Hz"
    )
