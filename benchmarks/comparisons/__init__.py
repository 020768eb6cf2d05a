"""What else could do our work: other classifiers and other transports, beside ours (README.md)."""
