"""Camera geometry: projective matrices, lens distortion, views and camera files."""
