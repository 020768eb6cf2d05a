"""Whole-system runs over real data: the experiments, their curves, plots and reports; and the demo."""
