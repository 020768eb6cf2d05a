"""Learning a model from recordings, editing it, and estimating how reliable it is."""
