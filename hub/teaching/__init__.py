"""`labanmesh teach`: one teacher for all observers of a scene."""
