"""`labanmesh new`: a package of one's own that extends labanmesh."""
