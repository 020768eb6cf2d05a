"""The MQTT hub: a scene's states and verdicts for Home Assistant and other MQTT clients (docs/guide/home.md)."""
