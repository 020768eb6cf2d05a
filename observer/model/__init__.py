"""Movement models: log P(observation | movement, phase), learned and stored."""
