"""Benchmarks: what labanmesh costs, each figure beside its floor, measured in the same run (`make bench`)."""
