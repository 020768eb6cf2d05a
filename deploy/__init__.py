"""How the mesh runs on machines: launcher, doctor, certificates and access rules, files for systemd and containers."""
