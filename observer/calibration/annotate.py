"""The annotated picture: corners as found beside where the calibrated camera would draw them."""

import cv2
import numpy as np

from observer.calibration.pictures import Picture
from observer.geometry.projection import Floats

FOUND, DRAWN, TEXT = (80, 220, 0), (0, 0, 255), (255, 255, 255)
"""Green rings, red crosses, white letters (BGR)."""


def annotated(picture: Picture, found: Floats, drawn: Floats, text: str) -> Picture:
    """(H, W, 3), (N, 2) corners found, (N, 2) corners projected -> a copy with rings, crosses and a line of text."""
    result = picture.copy()
    size = max(4, picture.shape[1] // 160)
    for u, v in np.round(found).astype(int).tolist():
        cv2.circle(result, (u, v), size, FOUND, 2, cv2.LINE_AA)
    for u, v in np.round(drawn[np.isfinite(drawn).all(axis=1)]).astype(int).tolist():
        cv2.drawMarker(result, (u, v), DRAWN, cv2.MARKER_CROSS, size, 1, cv2.LINE_AA)
    height = max(0.5, picture.shape[1] / 1600)
    for colour, width in (((0, 0, 0), 4), (TEXT, 1)):
        cv2.putText(result, text, (10, int(40 * height)), cv2.FONT_HERSHEY_SIMPLEX, height, colour, width, cv2.LINE_AA)
    return result
