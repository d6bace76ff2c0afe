"""The camera on the tool, and touch-up by what it sees."""
