"""The same traffic over several transports: our link, bare Zenoh, MQTT, NATS, ZeroMQ (`make peers-transport`)."""
