"""Scores of recorded performances: judging, the figure, and the verb `labanmesh score`."""
