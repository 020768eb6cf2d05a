"""Importers of other people's recordings, one file each, found by name."""
