"""The same traffic over other transports: Zenoh as we use it and bare, MQTT, NATS, ZeroMQ (`make peers-transport`)."""
