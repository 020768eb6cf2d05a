"""Bayes filters that turn the evidence of frames into a posterior over movements."""
