"""`labanmesh doctor`: what is wrong with this machine, scene file, cameras, network, security and mesh; what to do.

Most modules first collect facts, then check them; the checks are pure and begin with `check_`.
"""
