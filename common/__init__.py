"""What every process must agree on: vocabulary, probability, wire messages, keys, the Zenoh link, configuration."""
