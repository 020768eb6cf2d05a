"""Offline classifiers on the tracks of our observers: an upper reference, as they are given the whole segment."""
