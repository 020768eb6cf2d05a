"""Processes that listen to a scene: terminal view, capture, dashboard, MQTT bridge and health check."""
