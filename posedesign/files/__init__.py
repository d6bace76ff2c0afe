"""Files in and out: written whole or not at all, read up to a size, with their origin."""

from posedesign.files.csv_tables import LARGEST_NUMBER, LEAST_POSITIVE, load_json, usable
from posedesign.files.locking import held
from posedesign.files.origin import head_of, origin_of, rehearsed
from posedesign.files.safe import (
    MEASURED,
    Claim,
    Results,
    StrPath,
    check_writable,
    encoded,
    identity_of,
    json_text,
    kept_aside,
    make_folder,
    not_written,
    plain,
    read_bytes_bounded,
    write_bytes_atomic,
    write_json_atomic,
    write_text_atomic,
)

__all__ = [
    "LARGEST_NUMBER",
    "LEAST_POSITIVE",
    "MEASURED",
    "Claim",
    "Results",
    "StrPath",
    "check_writable",
    "encoded",
    "head_of",
    "held",
    "identity_of",
    "json_text",
    "kept_aside",
    "load_json",
    "make_folder",
    "not_written",
    "origin_of",
    "plain",
    "read_bytes_bounded",
    "rehearsed",
    "usable",
    "write_bytes_atomic",
    "write_json_atomic",
    "write_text_atomic",
]
