"""Recorded human motion: the archive format, and the importers of other people's formats."""
