"""What happened in a scene: kept in a file on the hub's machine, and shown."""
