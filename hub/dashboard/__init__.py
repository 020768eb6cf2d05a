"""The page: what `labanmesh watch` shows in a terminal, in a browser; read only."""
