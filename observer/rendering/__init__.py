"""The virtual camera: pictures of a performer of whom only hands and head were recorded."""
