"""Seeing what an observer sees: painted pictures of marks, motion and belief, in a window or in files."""
