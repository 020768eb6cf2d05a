"""Reading what else there is than the vocabulary's movements, as `labanmesh learn --background` names it."""

from pathlib import Path

from common.errors import BadInput
from common.text import split_list
from observer.background import BLENDS, blends_alone, gathered
from observer.learning import common_rate, prepared
from observer.motion.archive import MotionArchive
from observer.motion.archive_file import read_archive


def read_background(
    text: str, labels: str, learned: Path, whole: MotionArchive, subjects: tuple[str, ...]
) -> MotionArchive | None:
    """The texts of --background and --background-labels -> recordings; None where there is to be no background.

    learned: the archive that is learned from, and `whole` what of it; if it is named here too, only its `subjects` are
    taken. Raises BadInput for labels of no archive, and for what cannot be read or gathered.
    """
    chosen = split_list("--background-labels", labels)
    if chosen and text in ("", BLENDS):
        raise BadInput(f"--background-labels {labels}: of which archive? name it with --background")
    if text in ("", BLENDS):
        return blends_alone(whole.body_parts) if text else None
    paths = [Path(name) for name in split_list("--background", text)]
    archives = [prepared(read_archive(p), subjects if p.resolve() == learned.resolve() else ()) for p in paths]
    return gathered(archives, chosen, whole.body_parts, common_rate(whole))
