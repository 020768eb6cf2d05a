"""Offline classifiers on the very tracks that our judges get: how good one may be that is given the whole segment."""
