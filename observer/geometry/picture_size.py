"""Pictures of another size than that of the camera file: rescaled if the shape is the same, refused if not. Pure."""

from common.errors import BadInput
from observer.geometry.views import View

BLOCK_PX = 16
"""Encoders pad pictures to whole blocks at the right and below, or cut these off again: 1088 and 1080 are one size."""
SAME_SHAPE = 0.005
"""Relative difference of the two scales that rounding explains: 854x480 is 1920x1080."""

Size = tuple[int, int]


def picture_scale(view: View, size_px: Size) -> float:
    """From pixels of the pictures, which are `size_px` (width, height), to those of the view's camera file.

    1 for views without a size. Raises BadInput for pictures of another shape than the camera file's.
    """
    if view.size_px is None or _blocks(view.size_px) == _blocks(size_px):
        return 1.0
    across, down = (calibrated / actual for calibrated, actual in zip(view.size_px, size_px, strict=True))
    if abs(across - down) > SAME_SHAPE * across:
        width, height = view.size_px
        raise BadInput(
            f"pictures of {_text(size_px)} px, but the camera file of {view.name} is for {_text(view.size_px)}, "
            f"another shape; set size_px = [{width}, {height}] in the scene file, or calibrate again with such pictures"
        )
    return across


def scale_note(view: View, size_px: Size) -> str:
    """One line if the pictures are scaled to the camera file; "" if not. Raises BadInput as `picture_scale` does."""
    scale = picture_scale(view, size_px)
    if scale == 1.0 or view.size_px is None:
        return ""
    return (
        f"pictures of {_text(size_px)} px are scaled by {scale:.3g} to the {_text(view.size_px)} px of the camera file "
        f"of {view.name}: right if the camera shows as much in both sizes; if it cuts one out, calibrate again"
    )


def size_advice(view: View, size_px: Size) -> str:
    """`scale_note`, or why the pictures do not fit the camera file; "" if there is nothing to say."""
    try:
        return scale_note(view, size_px)
    except BadInput as error:
        return str(error)


def _blocks(size_px: Size) -> Size:
    return -(-size_px[0] // BLOCK_PX), -(-size_px[1] // BLOCK_PX)


def _text(size_px: Size) -> str:
    return f"{size_px[0]}x{size_px[1]}"
