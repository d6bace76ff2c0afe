"""Files of pose pairs, and of the answers to AX = ZB."""
