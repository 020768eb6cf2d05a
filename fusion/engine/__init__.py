"""The pure core of fusion: posteriors in, judgements and verdicts out, with time passed in."""
