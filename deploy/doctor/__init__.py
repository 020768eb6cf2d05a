"""`labanmesh doctor`: what is wrong with this machine, scene file, cameras, network, security and mesh; what to do.

Each look_*.py gathers facts; the module beside it, pure, says what they mean.
"""
