"""A synthetic performer: a kinematic model of four invented people and the paper's eight movements."""

from studies.performer.perform import MOVEMENTS, PEOPLE, perform, perform_continuously

__all__ = ["MOVEMENTS", "PEOPLE", "perform", "perform_continuously"]
