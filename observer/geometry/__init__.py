"""Views: how a point in the room becomes a point in an image."""
