"""Effort and Shape: how a movement is done, beside which one it is; formulas, evidence, learning, reading."""
