"""Bounds of scores and remarks, and a remark in words. The scores themselves: docs/design/score.md. Pure."""

BEST_SCORE = 10.0
LEAST_REFERENCES = 3
"""Reference takes of a movement: each is compared with the others, and with two there would be no spread of them."""
REMARKS_LIMIT = 3
"""Remarks on one performance: people remember no more."""
REMARK_LIMIT = 120
"""Characters of a remark in words, and of the reason why there is no score."""


def remark_words(joint: str, degrees: float, moment: float) -> str:
    """`left knee: 12 degrees too straight at 60 %`."""
    direction = "straight" if degrees > 0 else "bent"
    return f"{joint}: {abs(degrees):.0f} degrees too {direction} at {moment:.0%}".replace("%", " %")
