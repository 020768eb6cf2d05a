"""Movement models: log P(observation | movement, phase), learned from recordings and stored in files."""
