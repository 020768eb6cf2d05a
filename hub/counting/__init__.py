"""Counting repetitions of one movement: a tally with a target, and the verb `labanmesh count`."""
