"""How the mesh gets onto machines: the launcher that supervises all processes of one machine."""
