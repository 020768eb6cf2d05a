"""Teaching: an observer records takes of its own tracks, learns from them and goes on with the new model."""
