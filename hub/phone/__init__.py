"""A phone as a camera: the page that runs a pose model in its browser, and the server that takes the tracks."""
