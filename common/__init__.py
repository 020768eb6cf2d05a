"""What every process agrees on: vocabulary, probability, wire messages, keys, the Zenoh link, configuration."""

SECOND_NS = 1_000_000_000
"""Nanoseconds in a second."""
