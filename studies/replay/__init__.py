"""A capture judged again offline."""
