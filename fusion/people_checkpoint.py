"""The checkpoint files of a scene: one, or one for each of several people, read as one checkpoint."""

from collections.abc import Mapping
from pathlib import Path

from common.config import Scene
from fusion.checkpoint import Checkpoint, CheckpointFile


def checkpoint_file(scene: Scene, own: str) -> "CheckpointFile | PeopleFiles | None":
    """The files of the service `own`; None if the scene file wants none, or the scene comes from no file."""
    if scene.people.most == 1:
        return CheckpointFile.of(scene, own)
    files = {person: CheckpointFile.of(scene, own, person) for person in scene.people.ids}
    known = {person: file for person, file in files.items() if file is not None}
    return PeopleFiles(known) if known else None


class PeopleFiles:
    """The files of all people of a scene, by person; each person's worker writes its own."""

    def __init__(self, files: Mapping[str, CheckpointFile]) -> None:
        self.files = files

    def beside(self, suffix: str) -> Path:
        """The path of another file of the same service, in the same place."""
        return next(iter(self.files.values())).beside(suffix)

    def read(self, scene: str) -> Checkpoint | None:
        """The newest checkpoint of each person; None if there is none."""
        known = [each for file in self.files.values() if (each := file.read(scene)) is not None]
        return known[0].model_copy(update={"people": tuple(known[1:])}) if known else None
