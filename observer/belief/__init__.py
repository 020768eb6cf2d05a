"""Belief: the Bayes filters that turn evidence into a posterior over movements."""
