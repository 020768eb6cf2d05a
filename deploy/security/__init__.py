"""Certificates from a private authority, its register, and the router's access rules."""
