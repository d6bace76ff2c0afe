"""Studies: a question each, one command, and an answer with its figure."""
