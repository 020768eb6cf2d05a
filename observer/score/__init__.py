"""Scores of a performance, 0 to 10, against takes that show how it should be done (docs/design/score.md). Pure."""
