"""Foreign trackers: 2-D positions that another program found, read as JSON lines or from a Zenoh key."""
