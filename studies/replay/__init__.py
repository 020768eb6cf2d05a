"""A capture judged again offline, or played back onto a mesh."""
