"""What people say about the history: corrections, and what is to be forgotten; on the machine where the file lies."""

import logging
from collections.abc import Mapping

from common.config import Scene
from common.teaching_messages import Unwanted
from common.text import plural
from hub.database import DatabaseFault
from hub.history.history_file import HistoryFile

log = logging.getLogger("labanmesh.hub")


def note_corrections(scene: Scene, labels: Mapping[str, str]) -> None:
    """Note what movements were, by the id of their verdicts; "" for none. A file that cannot be written is one line."""
    if not labels or not _is_here(scene):
        return
    try:
        with HistoryFile.to_write(scene.place(scene.history.file)) as file:
            file.correct(dict(labels))
    except DatabaseFault as error:
        log.warning("history: not corrected there: %s", error)


def forget_in_history(scene: Scene, unwanted: Unwanted) -> str:
    """Delete the rows of a movement, or all; one line that says what was done, "" for a scene without a history.

    Raises DatabaseFault if they are still there.
    """
    if not scene.history.file:
        return ""
    if not _is_here(scene):
        return "history: its file is not on this machine; give the command where labanmesh hub events runs"
    if unwanted.person:
        return "history: says of nobody who moved, so nothing is removed from it"
    with HistoryFile.to_write(scene.place(scene.history.file)) as file:
        return f"history: {plural(file.forget('' if unwanted.everything else unwanted.label), 'row')} removed"


def _is_here(scene: Scene) -> bool:
    return bool(scene.history.file) and scene.place(scene.history.file).exists()
