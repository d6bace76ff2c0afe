"""``python -m posedesign``."""

from posedesign.cli.main import main

main()
