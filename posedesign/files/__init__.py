"""Files in and out: written whole or not at all, read up to a size, with their origin."""

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
    read_bytes_bounded,
    write_bytes_atomic,
    write_json_atomic,
    write_text_atomic,
)

__all__ = [
    "MEASURED",
    "Claim",
    "Results",
    "StrPath",
    "check_writable",
    "encoded",
    "identity_of",
    "json_text",
    "kept_aside",
    "make_folder",
    "read_bytes_bounded",
    "write_bytes_atomic",
    "write_json_atomic",
    "write_text_atomic",
]
