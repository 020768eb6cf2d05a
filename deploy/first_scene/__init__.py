"""The first scene file of a machine: its cameras, and what to do next."""
