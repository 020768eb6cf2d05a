"""One observer: camera, tracks, features, filter, posterior; and how it learns a model for its view."""
