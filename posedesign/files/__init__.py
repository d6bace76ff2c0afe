"""Files in and out: written whole or not at all, read up to a size, with their origin."""

from posedesign.files.csv_tables import LARGEST_NUMBER as LARGEST_NUMBER
from posedesign.files.csv_tables import LEAST_POSITIVE as LEAST_POSITIVE
from posedesign.files.csv_tables import load_json as load_json
from posedesign.files.csv_tables import usable as usable
from posedesign.files.locking import held as held
from posedesign.files.origin import head_of as head_of
from posedesign.files.origin import origin_of as origin_of
from posedesign.files.origin import rehearsed as rehearsed
from posedesign.files.safe import MEASURED as MEASURED
from posedesign.files.safe import Claim as Claim
from posedesign.files.safe import Results as Results
from posedesign.files.safe import StrPath as StrPath
from posedesign.files.safe import check_writable as check_writable
from posedesign.files.safe import encoded as encoded
from posedesign.files.safe import folder_inside as folder_inside
from posedesign.files.safe import identity_of as identity_of
from posedesign.files.safe import json_text as json_text
from posedesign.files.safe import kept_aside as kept_aside
from posedesign.files.safe import make_folder as make_folder
from posedesign.files.safe import not_written as not_written
from posedesign.files.safe import plain as plain
from posedesign.files.safe import read_bytes_bounded as read_bytes_bounded
from posedesign.files.safe import write_bytes_atomic as write_bytes_atomic
from posedesign.files.safe import write_json_atomic as write_json_atomic
from posedesign.files.safe import write_text_atomic as write_text_atomic
