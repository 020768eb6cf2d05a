"""Tracks of others: 2-D positions that any other tracker found, as JSON lines or on a Zenoh key."""
