"""The virtual camera: pictures of a performer whose hands and head alone were recorded."""
