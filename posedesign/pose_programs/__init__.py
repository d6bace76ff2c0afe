"""From a plan to the controller's program, and from the touched-up program back to touch-ups."""
