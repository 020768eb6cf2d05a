"""One new recording of a motion archive: its name, its positions and a report of their quality; pure."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from common.errors import BadInput
from common.text import plural
from observer.motion.archive import ARCHIVE_LABEL_RULE, MotionArchive, Recording, is_label
from observer.recording.own_tracks import shares_text
from observer.recording.reconstruction import (
    FRONT,
    UP,
    CameraTracks,
    fill_gaps,
    moving_span,
    remove_spikes,
    to_performer_axes,
)
from observer.recording.triangulation import (
    Progress,
    ReconstructedParts,
    Reconstruction,
    camera_rate_hz,
    px_per_m,
    reconstruct_parts,
)
from observer.tracks import BODY_PARTS, Floats

AROUND_S = 0.1
"""A position is replaced by the parabola through those within AROUND_S: a low pass of 6 Hz at 60 Hz, the usual limit of
human movement (Winter, Biomechanics and Motor Control of Human Movement, 2009, section 3.4.4)."""
ORDER = 2
EXACT_M = 0.003
"""Parts whose tracks are more exact than this are left as they are: the parabola cuts about as much off the turns of a
hand that waves by 25 cm twice a second."""


def noise_m(matrices: Sequence[Floats], result: Reconstruction) -> Floats:
    """(P,) the standard error of one camera's track of each part, in metres where the part is; 0 where unknown.

    The median over the instants; 2n - 3 degrees of freedom are left from n cameras.
    """
    squares = np.where(result.inliers, result.errors_px, 0.0) ** 2
    count = result.inliers.sum(axis=2)
    noise_px = np.sqrt(squares.sum(axis=2) / np.maximum(2 * count - 3, 1))
    noise = np.where(count >= 2, noise_px / px_per_m(matrices, result.positions), np.nan)
    return np.array(
        [np.median(of_part[np.isfinite(of_part)]) if np.isfinite(of_part).any() else 0.0 for of_part in noise.T]
    )


def smoothed(positions: Floats, rate_hz: float, noise: Floats) -> Floats:
    """(K, P, 3) and (P,) m -> (K, P, 3) smoothed over time by a Savitzky-Golay filter; NaN stays.

    Parts whose noise is below EXACT_M, runs between gaps that are shorter than the filter, and rates below 20 Hz, for
    which it has three positions only, are left as they are.
    """
    from scipy.signal import savgol_filter

    reach = int(AROUND_S * rate_hz + 1e-9)
    length, result = 2 * reach + 1, positions.copy()
    if length <= ORDER + 1:
        return result
    for part in np.flatnonzero(noise >= EXACT_M):
        known = np.isfinite(positions[:, part]).all(axis=1)
        edges = np.flatnonzero(np.diff(np.concatenate([[False], known, [False]]).astype(np.int8)))
        for begin, end in zip(edges[::2], edges[1::2], strict=True):
            if end - begin >= length:
                result[begin:end, part] = savgol_filter(positions[begin:end, part], length, ORDER, axis=0)
    return result


OUTLIER_SHARE = 0.1
"""A camera that is an outlier more often than this gets a line of its own."""
LITTLE_KNOWN_SHARE = 0.5
"""If hands and head are known in fewer of the instants, the lines say what each camera saw."""


def with_trial(blank: Recording, archive: MotionArchive | None, body_parts: tuple[str, ...], path: str) -> Recording:
    """`blank`, a recording without frames, with its own trial or the next free number. Called before the performance.

    Raises BadInput, naming `path`, for an archive of other body parts or another rate, for a trial that it already
    has, and for an invalid label or subject.
    """
    if not is_label(blank.label):
        raise BadInput(f"--label {blank.label!r}: {ARCHIVE_LABEL_RULE}")
    if not blank.subject.strip() or not blank.subject.isprintable():
        raise BadInput(f"--subject {blank.subject!r}: the performer's name in printable characters is expected")
    if archive is None:
        return replace(blank, trial=blank.trial or "1")
    if archive.body_parts != body_parts:
        theirs, ours = ", ".join(archive.body_parts), ", ".join(body_parts)
        raise BadInput(f"{path}: contains {theirs}, but this records {ours}; choose another file with -o")
    other = next((r.rate_hz for r in archive.recordings if r.rate_hz != blank.rate_hz), None)
    if other is not None:
        raise BadInput(f"{path}: has a rate of {other:g} Hz; use --rate {other:g}, or another file with -o")
    trials = [r.trial for r in archive.recordings if (r.label, r.subject) == (blank.label, blank.subject)]
    if blank.trial in trials:
        raise BadInput(
            f"{path}: has trial {blank.trial} of {blank.label or 'other motion'} by {blank.subject}; omit --trial"
        )
    return replace(blank, trial=blank.trial or str(max((int(t) for t in trials if t.isdecimal()), default=0) + 1))


def build_recording(
    tracks: Sequence[CameraTracks],
    body_parts: Sequence[str],
    blank: Recording,
    progress: Progress = lambda *_: None,
    *,
    gate_px: float | None = None,
    up: str = UP,
    front: str = FRONT,
    trim: bool = False,
) -> tuple[Recording, list[str]]:
    """`blank` with triangulated positions at its own rate, and lines about their quality.

    gate_px: as `reconstruct_parts` has it. up, front: axes of the room. trim: cut off the idle ends.
    Raises BadInput when the cameras have no common time, and NothingRecorded when no position was found.
    """
    each = max(1, round(camera_rate_hz(tracks) / blank.rate_hz))
    rate_hz = each * blank.rate_hz
    reconstructed = reconstruct_parts(tracks, body_parts, rate_hz, gate_px, progress)
    result = reconstructed.result
    positions = fill_gaps(remove_spikes(result.positions, rate_hz), rate_hz)
    positions = smoothed(positions, rate_hz, noise_m(reconstructed.matrices, result))[::each]
    positions = to_performer_axes(positions, up, front)
    lines = quality_lines(reconstructed.cameras, body_parts, result, positions)
    lines += exchange_lines(reconstructed)
    lines += [f"{camera.name}: delivered no picture" for camera in tracks if not len(camera.at_ns)]
    if not np.isfinite(positions).any():
        raise NothingRecorded(
            cause_of(reconstructed.result), [*visibility_lines(tracks, body_parts, reconstructed.result)]
        )
    if np.isfinite(positions[:, _needed(body_parts)]).all(axis=(1, 2)).mean() < LITTLE_KNOWN_SHARE:
        lines += visibility_lines(tracks, body_parts, result)
    if trim:
        hands = [row for row, part in enumerate(body_parts) if part.endswith("hand")]
        positions = positions[slice(*moving_span(positions, hands, blank.rate_hz))]
    return replace(blank, positions=positions.astype(np.float32)), lines


def exchange_lines(reconstructed: ReconstructedParts) -> list[str]:
    """A line for each camera that exchanged left and right more often than OUTLIER_SHARE."""
    pairs = len(reconstructed.result.positions) * max(len(reconstructed.pairs), 1)
    return [
        f"{camera}: left and right were exchanged in {count / pairs:.0%} of the time and have been put right"
        for camera, count in zip(reconstructed.cameras, reconstructed.exchanged, strict=True)
        if count > OUTLIER_SHARE * pairs
    ]


def quality_lines(names: Sequence[str], body_parts: Sequence[str], result: Reconstruction, final: Floats) -> list[str]:
    """One line for all cameras, and one for each camera with a problem; final: (K, P, 3) the repaired positions."""
    known = np.logical_and.reduce(np.isfinite(final), axis=-1)
    shares = shares_text(dict(zip(body_parts, known.mean(axis=0).tolist(), strict=True)))
    errors = result.errors_px[result.inliers]
    error = f"median reprojection error {np.median(errors):.1f} px" if len(errors) else "no position found"
    needed = _needed(body_parts)
    name, share = "hands and head" if len(needed) < len(body_parts) else "all parts", known[:, needed].all(axis=1)
    head = f"{name} in {share.mean():.0%} of {len(final)} instants ({shares}); {error}"
    return [head, *filter(None, (_camera_line(n, name, result) for n, name in enumerate(names)))]


def _needed(body_parts: Sequence[str]) -> list[int]:
    """The rows of hands and head: feet and knees are often out of the picture."""
    return [row for row, part in enumerate(body_parts) if part in BODY_PARTS]


def outlier_shares(result: Reconstruction) -> Floats:
    """(N,) for each camera, the share of its observations of known positions that are outliers; NaN for none."""
    known = np.isfinite(result.positions).all(axis=-1, keepdims=True)
    observed = result.observed & known
    outliers = (observed & ~result.inliers).sum(axis=(0, 1))
    total = observed.sum(axis=(0, 1))
    return np.where(total > 0, outliers / np.maximum(total, 1), np.nan)


def _camera_line(n: int, name: str, result: Reconstruction) -> str:
    if not result.observed[..., n].any():
        return f"{name}: saw no part; labanmesh camera look shows what its tracker finds"
    share = outlier_shares(result)[n]
    if np.isnan(share):
        return f"{name}: agrees with no other camera; check its calibration"
    if share > OUTLIER_SHARE:
        return f"{name}: rejected in {share:.0%} of what it saw; check its calibration and its tracker"
    return ""


NOBODY_SEEN = (
    "no camera saw any part",
    "labanmesh camera look SOURCE shows what a tracker finds. camshift needs a face that looks at the camera, or the "
    'colour of the skin (skin = "skin.npz" in the scene file); tracker = "mediapipe" needs neither',
)
ONE_VIEW = (
    "no part was seen by two cameras at one moment",
    "Stand where at least two cameras see face and hands, nearer or in better light; or set "
    'tracker = "mediapipe" in the scene file',
)
DISAGREE = (
    "the cameras saw the same parts, and no two agree where they are",
    "Calibrate the cameras again, or give their pictures the size that their camera files state; a larger --gate "
    "lets coarse tracks pass",
)


class NothingRecorded(BadInput):
    """No position was found. lines: what each camera saw, for people."""

    def __init__(self, cause: str, lines: Sequence[str]) -> None:
        super().__init__(f"nothing was recorded: {cause}")
        self.lines = tuple(lines)


def cause_of(result: Reconstruction) -> str:
    """Why no part has a position, and what to do, in one line."""
    twice = (result.observed.sum(axis=-1) > 1).any()
    cause, remedy = NOBODY_SEEN if not result.observed.any() else DISAGREE if twice else ONE_VIEW
    return f"{cause}. {remedy}"


def visibility_lines(
    tracks: Sequence[CameraTracks], body_parts: Sequence[str], result: Reconstruction | None = None
) -> Iterator[str]:
    """One line for each camera: in how many of its pictures it saw each part; and how often two did at one moment."""
    for camera in tracks:
        counts = np.isfinite(camera.centres).all(axis=-1).sum(axis=0)
        words = ", ".join(f"{part} in {count}" for part, count in zip(body_parts, counts.tolist(), strict=True))
        pictures = plural(len(camera.at_ns), "picture")
        line = f"{pictures}; saw {words}" if len(camera.at_ns) else "no picture"
        yield f"{camera.name}: {line}{f'; its tracker says: {camera.complaint}' if camera.complaint else ''}"
    if result is not None:
        twice = (result.observed.sum(axis=-1) > 1).sum(axis=0)
        words = ", ".join(f"{part} in {count}" for part, count in zip(body_parts, twice.tolist(), strict=True))
        yield f"two cameras at one moment: {words} of {plural(len(result.observed), 'instant')}"
