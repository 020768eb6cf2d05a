"""What a recording is worth, in lines for a person: how much was seen, how exactly, and who was outvoted; pure."""

from collections.abc import Sequence

import numpy as np

from observer.recording.rebuilding import Rebuilt
from observer.tracks import Floats

OUTVOTED = 0.1
"""A camera that contradicts the others more often than this is worth a line of its own."""


def summary(names: Sequence[str], body_parts: Sequence[str], rebuilt: Rebuilt, final: Floats) -> list[str]:
    """One line for all, one more for each camera that had little say; final: (K, P, 3) the positions, mended."""
    whole = np.logical_and.reduce(np.isfinite(final), axis=-1)
    seen = ", ".join(f"{part} {share:.0%}" for part, share in zip(body_parts, whole.mean(axis=0), strict=True))
    errors = rebuilt.errors_px[rebuilt.used]
    exactness = f"median reprojection error {np.median(errors):.1f} px" if len(errors) else "no position found"
    head = f"all parts in {whole.all(axis=1).mean():.0%} of {len(final)} instants ({seen}); {exactness}"
    return [head, *filter(None, (_camera(n, name, rebuilt) for n, name in enumerate(names)))]


def rejected(rebuilt: Rebuilt) -> Floats:
    """(N,) of what each camera saw and others placed, the share in which it was outvoted; NaN where there is none."""
    found = np.isfinite(rebuilt.positions).all(axis=-1, keepdims=True)
    judged = rebuilt.seen & found
    outvoted = (judged & ~rebuilt.used).sum(axis=(0, 1))
    total = judged.sum(axis=(0, 1))
    return np.where(total > 0, outvoted / np.maximum(total, 1), np.nan)


def _camera(n: int, name: str, rebuilt: Rebuilt) -> str:
    if not rebuilt.seen[..., n].any():
        return f"{name}: saw no part at all; labanmesh look shows what its tracker finds"
    share = rejected(rebuilt)[n]
    if np.isnan(share):
        return f"{name}: agrees with no other camera; look at its calibration"
    if share > OUTVOTED:
        return f"{name}: rejected in {share:.0%} of what it saw; look at its calibration and at what its tracker finds"
    return ""
