"""Files of trackers, measuring arms and motion capture, and the joints that go with them."""

from posedesign.identification.instruments.measured import (
    Measured,
    goes_with_temperature,
    is_of_instrument,
    read_measured,
)

__all__ = ["Measured", "goes_with_temperature", "is_of_instrument", "read_measured"]
