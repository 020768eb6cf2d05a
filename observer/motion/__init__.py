"""Recorded human motion: the archive format, its transforms and playback, and importers of other formats."""
