"""Trackers: pictures become tracks of the hands and the head."""
