"""What an identified robot is for: a corrected chain, its URDF, and commands that compensate."""
