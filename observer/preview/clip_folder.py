"""The folder of an observer's clips: their names, and which of them are deleted."""

import os
import re
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from common import SECOND_NS
from observer.files import remove_file, write_file

DAY_NS = 86_400 * SECOND_NS
MB = 1_000_000
NAME = re.compile(r"\d{8}T\d{6}Z_[a-z0-9_-]+_[\w-]+_[\w-]+\.avi\Z")
"""Files with another name are never deleted."""
UNSAFE = re.compile(r"[^A-Za-z0-9-]+")
LONGEST = 64
"""Characters of a label or an id in a name: both come from peers."""
WAY_OUT = "Free space, or lower clips.keep_mb"


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
        write_file(path, content, WAY_OUT)
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
        files = [path for path in self.path.iterdir() if NAME.match(path.name)]
        # Another observer may delete one at this moment.
        return [(status.st_mtime_ns, path, status.st_size) for path in files if (status := _status(path))]


def clip_name(at_ns: int, observer: str, label: str, verdict_id: str) -> str:
    """`20261122T145721Z_sofa_wave_f3a1-17.avi`: when it was decided (UTC), the observer, the label, the verdict."""
    moment = datetime.fromtimestamp(at_ns / SECOND_NS, UTC)
    return "_".join([f"{moment:%Y%m%dT%H%M%SZ}", observer, _safe(label), _safe(verdict_id)]) + ".avi"


def _safe(word: str) -> str:
    return UNSAFE.sub("-", word)[:LONGEST] or "-"


def _is_of(path: Path, observer: str, label: str) -> bool:
    """Whether a clip is of the observer, and of the label unless that is ""; an observer's id may hold underscores."""
    begin, of_label, _ = path.name.rsplit("_", 2)
    return begin.split("_", 1)[1] == observer and (not label or of_label == _safe(label))


def _status(path: Path) -> os.stat_result | None:
    try:
        return path.stat()
    except FileNotFoundError:
        return None
