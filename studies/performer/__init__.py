"""A synthetic performer: a kinematic model of four people doing the paper's eight movements."""
