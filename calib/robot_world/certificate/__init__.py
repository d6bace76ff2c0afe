"""Proof that a solution of A X = Z B is the global optimum."""
