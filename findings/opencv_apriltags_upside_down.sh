#!/usr/bin/env bash
# OpenCV 4.14.0 and AprilRobotics' detector (pupil-apriltags 1.0.4): the same tag, two frames.
#
# Expected: a tag that OpenCV draws from its dictionary of AprilTags, and finds upright, is upright
#   to the detector of those who made the tags, too. Number, family and size agree.
# Happens: every tag that OpenCV draws is upside down to AprilRobotics' detector: its left upper
#   corner is OpenCV's right lower one, so the frame of the tag is turned by 180 deg about its
#   normal. Both detectors find the tag, with the right number and the same four points.
# Matters: nothing fails. A hand-eye calibration by one library, whose target is then found by the
#   other, has the target half a turn off. In grids, the corners of each tag change places.
# Here: calib/vision/boards/finding.py (turns_of) tries both ways round for boards of AprilTags, and
#   board.py beside it draws those of its grids as AprilRobotics does (is_apriltag). Test:
#   tests/unit/vision/boards/test_boards.py, which asks pupil-apriltags as well.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check \
    opencv-python-headless==4.14.0.94 pupil-apriltags==1.0.4.post11 numpy==2.4.6

"$work/venv/bin/python" - <<'PY'
import sys
from importlib.metadata import version

import cv2
import numpy as np
from pupil_apriltags import Detector

FIRST, LAST = 100, 299  # pixels of the tag in the picture

dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
of_opencv = cv2.aruco.ArucoDetector(dictionary)
of_apriltag = Detector(families="tag36h11")
print("opencv", version("opencv-python-headless"), "pupil-apriltags", version("pupil-apriltags"))
for number in (0, 5, 23, 101, 586):
    picture = np.full((400, 400), 255, np.uint8)
    tag = cv2.aruco.generateImageMarker(dictionary, number, LAST + 1 - FIRST)
    picture[FIRST : LAST + 1, FIRST : LAST + 1] = tag
    corners, ids, _ = of_opencv.detectMarkers(picture)
    left_upper = corners[0][0, 0]
    (found,) = of_apriltag.detect(picture)
    x, y, w = found.homography @ [-1, -1, 1]  # the left upper corner in the frame of the tag
    theirs = np.array([x, y]) / w
    print(
        f"tag {number}: read as {ids.item()} and {found.tag_id}; left upper corner at "
        f"{left_upper.round().astype(int).tolist()} by OpenCV, "
        f"{theirs.round().astype(int).tolist()} by AprilRobotics"
    )
    same = np.abs(left_upper - FIRST).max() < 3 and ids.item() == found.tag_id == number
    if not (same and np.abs(theirs - LAST).max() < 3):
        sys.exit("The behaviour has changed.")
print("OpenCV's AprilTags are turned by 180 deg against those of AprilRobotics.")
PY
