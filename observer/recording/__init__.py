"""Recording: what several calibrated cameras see becomes motion in space, to learn from."""
