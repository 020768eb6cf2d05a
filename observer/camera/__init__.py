"""Pictures for an observer: live cameras, video files, folders of pictures; `opening.open_pictures` is the door."""
