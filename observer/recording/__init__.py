"""Recording: tracks of several calibrated cameras become motion in space, to learn from."""
