"""Words as large letters of a terminal, to be read from the other side of a room. Pure."""

FONT = {
    "0": "### # # # # # # ###", "1": " #  ##   #   #  ###", "2": "###   # ### #   ###", "3": "###   # ###   # ###",
    "4": "# # # # ###   #   #", "5": "### #   ###   # ###", "6": "### #   ### # # ###", "7": "###   #   #   #   #",
    "8": "### # # ### # # ###", "9": "### # # ###   # ###", "A": "### # # ### # # # #", "B": "##  # # ##  # # ## ",
    "C": "### #   #   #   ###", "D": "##  # # # # # # ## ", "E": "### #   ##  #   ###", "F": "### #   ##  #   #  ",
    "G": "### #   # # # # ###", "H": "# # # # ### # # # #", "I": "###  #   #   #  ###", "J": "  #   #   # # # ###",
    "K": "# # # # ##  # # # #", "L": "#   #   #   #   ###", "M": "# # ### ### # # # #", "N": "##  # # # # # # # #",
    "O": "### # # # # # # ###", "P": "### # # ### #   #  ", "Q": "### # # # # ###   #", "R": "### # # ##  # # # #",
    "S": "### #   ###   # ###", "T": "###  #   #   #   # ", "U": "# # # # # # # # ###", "V": "# # # # # # # #  # ",
    "W": "# # # # ### ### # #", "X": "# # # #  #  # # # #", "Y": "# # # # ###  #   # ", "Z": "###   #  #  #   ###",
}  # fmt: skip
"""Five rows of three squares each, with a space between two rows."""
ROWS, WIDE, PITCH = 5, 3, 4
SQUARES_WIDE = 2
"""Columns of a square: a terminal's characters are twice as high as wide."""
LARGEST_SCALE = 4


def big(text: str, columns: int, lines: int) -> list[str]:
    """The text in letters as large as fit into so many columns and lines; [] where none fit.

    What the font lacks, such as an underscore, is a gap.
    """
    letters = [_rows(letter) for letter in text.upper()]
    squares = max(PITCH * len(letters) - 1, 1)
    scale = min(columns // (SQUARES_WIDE * squares), lines // ROWS, LARGEST_SCALE)
    if not letters or scale < 1:
        return []
    width = SQUARES_WIDE * scale
    rows = [" ".join(letter[row] for letter in letters) for row in range(ROWS)]
    drawn = ["".join(("█" if square == "#" else " ") * width for square in row).rstrip() for row in rows]
    return [row for row in drawn for _ in range(scale)]


def _rows(letter: str) -> list[str]:
    pattern = FONT.get(letter, "").ljust(PITCH * ROWS - 1)
    return [pattern[PITCH * row : PITCH * row + WIDE] for row in range(ROWS)]
