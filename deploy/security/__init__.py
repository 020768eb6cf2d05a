"""Who may speak on the mesh: a private certificate authority, its register, and the router's access rules."""
