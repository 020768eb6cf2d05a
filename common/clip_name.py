"""The names of clips of verdicts: made by observers, and found by hubs on the same machine. Pure."""

import re
from datetime import UTC, datetime

from common import SECOND_NS

CLIP_NAME = re.compile(r"\d{8}T\d{6}Z_[a-z0-9_-]+_[\w-]+_[\w-]+\.avi\Z")
"""Files with another name are no clips."""
UNSAFE = re.compile(r"[^A-Za-z0-9-]+")
MOST_CHARACTERS = 64
"""Characters of a label or an id in a name: both come from peers."""


def clip_name(at_ns: int, observer: str, label: str, verdict_id: str) -> str:
    """`20261122T145721Z_sofa_wave_f3a1-17.avi`: when it was decided (UTC), the observer, the label, the verdict."""
    moment = datetime.fromtimestamp(at_ns / SECOND_NS, UTC)
    return "_".join([f"{moment:%Y%m%dT%H%M%SZ}", observer, safe_word(label), safe_word(verdict_id)]) + ".avi"


def clip_parts(name: str) -> tuple[str, str, str] | None:
    """The observer, the label and the verdict in a clip's name, as `safe_word` has them; None for no clip's name.

    An observer's id may hold underscores.
    """
    if not CLIP_NAME.match(name):
        return None
    begin, label, verdict = name.removesuffix(".avi").rsplit("_", 2)
    return begin.split("_", 1)[1], label, verdict


def safe_word(word: str) -> str:
    """A label or an id as it stands in a name."""
    return UNSAFE.sub("-", word)[:MOST_CHARACTERS] or "-"
