"""Calibration: where a camera stands and how its lens maps, from boards, known points or files of others."""
