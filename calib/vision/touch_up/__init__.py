"""Visual touch-up: a robot brings the camera on its flange to a target by what the camera sees."""
