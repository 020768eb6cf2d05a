"""Previews: painted pictures of tracks, motion and posterior, in a window or in files."""
