"""`labanmesh completion`: what Tab completes in a shell."""
