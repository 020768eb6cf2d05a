"""Calibration: intrinsics and extrinsics of cameras, from boards, known points or files of other programs."""
