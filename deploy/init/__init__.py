"""`labanmesh init`: a commented scene file for the cameras of this machine."""
