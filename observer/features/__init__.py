"""Features of motion in the image: Laban's Space as Vector Symbols, and posture."""
