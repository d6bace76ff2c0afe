"""Motions between poses: their order, what is in their way, and how long the tour takes."""
