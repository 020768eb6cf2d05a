"""Text on pictures: written so that it fits, in the letters that OpenCV has."""

import unicodedata

import cv2

from observer.preview.sight import Picture

Colour = tuple[int, int, int]
"""Blue, green, red, 0 to 255."""

FONT, BOLD = cv2.FONT_HERSHEY_SIMPLEX, cv2.FONT_HERSHEY_DUPLEX
SMALL, PLAIN, LARGE = 0.42, 0.5, 0.75
"""Sizes of letters; PLAIN has capitals of about 11 px."""


def write(
    canvas: Picture,
    text: str,
    at: tuple[int, int],
    colour: Colour,
    size: float = PLAIN,
    *,
    width_px: int | None = None,
    bold: bool = False,
    outlined: bool = False,
) -> None:
    """Text from `at` (left end of the base line, px), cut off with two dots where it is wider than `width_px`.

    outlined: a black edge, for letters on a picture.
    """
    text = fitting(text, size, width_px) if width_px is not None else plain(text)
    if outlined:
        cv2.putText(canvas, text, at, FONT, size, (0, 0, 0), 4, cv2.LINE_AA)
    cv2.putText(canvas, text, at, BOLD if bold else FONT, size, colour, 1, cv2.LINE_AA)


def plain(text: str) -> str:
    """The text in ASCII: accents go, what has no letter becomes a question mark, ends of lines become blanks."""
    bare = "".join(c for c in unicodedata.normalize("NFKD", text) if not unicodedata.combining(c))
    return "".join(c if " " <= c <= "~" else "?" for c in " ".join(bare.split()))


def width_of(text: str, size: float = PLAIN) -> int:
    """Width in px of a text as `write` draws it."""
    return int(cv2.getTextSize(plain(text), FONT, size, 1)[0][0])


def fitting(text: str, size: float, width_px: int) -> str:
    """The text in ASCII, cut off with two dots where it is wider than that; "" where not even those fit."""
    text = plain(text)
    if width_of(text, size) <= width_px:
        return text
    low, high = 0, len(text)
    while low < high:
        middle = (low + high + 1) // 2
        low, high = (middle, high) if width_of(text[:middle] + "..", size) <= width_px else (low, middle - 1)
    return text[:low] + ".." if low else ""


def wrapped(text: str, size: float, width_px: int, lines: int) -> list[str]:
    """The text in at most so many lines of that width; the last is cut off by `write` where it is too long."""
    words, found = plain(text).split(), [""]
    for word in words:
        longer = f"{found[-1]} {word}".strip()
        if len(found) == lines or not found[-1] or width_of(longer, size) <= width_px:
            found[-1] = longer
        else:
            found.append(word)
    return found
