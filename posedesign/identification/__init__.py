"""The robot identified from a cell's measurements, and corrected with what was identified."""
