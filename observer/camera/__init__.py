"""Picture sources for an observer: live cameras, video files and picture folders. Start at `opening.open_pictures`."""
