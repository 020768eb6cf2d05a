"""Home Assistant, and whoever else speaks MQTT: a scene's states and verdicts through a broker (docs/guide/home.md)."""
