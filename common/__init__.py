"""Shared by every process: vocabulary, probability, wire messages, keys, the Zenoh link, configuration."""

MS_NS = 1_000_000
SECOND_NS = 1_000_000_000
MINUTE_NS = 60 * SECOND_NS
