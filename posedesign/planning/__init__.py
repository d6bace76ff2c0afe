"""Measuring poses: the paper's loop, checks of what was planned, and the best poses of a cell."""
