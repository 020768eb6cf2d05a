"""The folder of an observer's clips: their names, and which of them are deleted."""

import os
from dataclasses import dataclass
from pathlib import Path

from common import SECOND_NS
from common.clip_name import clip_parts, safe_word
from observer.files import remove_file, write_file

DAY_NS = 86_400 * SECOND_NS
MB = 1_000_000
FREE_CLIPS_SPACE = "Free space, or lower clips.keep_mb"


@dataclass(frozen=True, slots=True)
class ClipFolder:
    """Clips in `path`, which several observers of one machine may share; nobody else may read them."""

    path: Path
    keep_days: float
    keep_mb: float

    def add(self, name: str, content: bytes, now_ns: int) -> Path:
        """Write a clip, after room was made for it; raises LabanmeshError or OSError."""
        self.path.mkdir(mode=0o700, parents=True, exist_ok=True)
        self.delete_old(now_ns, len(content))
        path = self.path / name
        write_file(path, content, FREE_CLIPS_SPACE)
        path.chmod(0o600)
        return path

    def delete_old(self, now_ns: int, coming_bytes: int = 0) -> int:
        """Delete clips older than `keep_days`, and the oldest until all fit `keep_mb`; returns how many."""
        clips = sorted(self._clips())
        total = coming_bytes + sum(size for _, _, size in clips)
        deleted = 0
        for written_ns, path, size in clips:
            if total <= self.keep_mb * MB and now_ns - written_ns <= self.keep_days * DAY_NS:
                break
            path.unlink(missing_ok=True)
            total, deleted = total - size, deleted + 1
        return deleted

    def delete_of(self, observer: str, label: str = "") -> int:
        """Delete the clips of an observer, of this label if one is given; returns how many. Raises LabanmeshError."""
        own = [path for _, path, _ in self._clips() if _is_of(path, observer, label)]
        for path in own:
            remove_file(path)
        return len(own)

    def _clips(self) -> list[tuple[int, Path, int]]:
        if not self.path.is_dir():
            return []
        files = [path for path in self.path.iterdir() if clip_parts(path.name)]
        # Another observer may delete one at this moment.
        return [(status.st_mtime_ns, path, status.st_size) for path in files if (status := _status(path))]


def _is_of(path: Path, observer: str, label: str) -> bool:
    """Whether a clip is of the observer, and of the label unless that is ""."""
    parts = clip_parts(path.name)
    return parts is not None and parts[0] == observer and (not label or parts[1] == safe_word(label))


def _status(path: Path) -> os.stat_result | None:
    try:
        return path.stat()
    except FileNotFoundError:
        return None
