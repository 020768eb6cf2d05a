"""What this process's certificate allows a hub to do."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from common.config import Scene


def has_right(scene: "Scene", right: str) -> bool:
    """Whether this process's certificate, if the mesh has any, is for `pictures`, to `teach`, or for `history`."""
    if not scene.mesh.credentials:
        return True
    # Slow to import, and needed only with certificates.
    from common.credentials import own_certificate

    return own_certificate(Path(scene.mesh.credentials)).is_for(right)
