"""The folder that the stills of a recording are written into: pictures, tables, the lens.

=======================  ===========================================================================
``pictures/P001.png ..``  the stills, in grey
``joints.csv``            joints of each (``<joint>_rad``), or the rows of the table that was given
``poses.csv``             poses of the flange in place of them
``stills.csv``            the stand-stills: from when to when, and the still or why there is none
``lens_of_bag.yaml``      the lens of ``camera_info``, where it is asked for
=======================  ===========================================================================
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from calib.errors import CalibError, InputError, OutputError
from calib.hand_eye.pictures import NEAR_S
from calib.lens import Lens
from calib.robots import Robot
from calib.se3 import FloatArray, quaternion_from_rotation
from calib.vision.camera.rendering import GreyImage
from posedesign.files import Results, folder_inside, write_bytes_atomic, write_text_atomic
from posedesign.files.csv_tables import AsItIs, Row, Table, a_few, as_read, write_table
from posedesign.files.origin import origin_of
from posedesign.files.pictures import ENDINGS
from posedesign.files.postures import RADIAN_DECIMALS, JointForm, cells_of, columns_of
from posedesign.hand_eye.lens_files import camera_info
from posedesign.hand_eye.recordings.arm_streams import ArmStream
from posedesign.hand_eye.recordings.stills import StandStill, why_not

Advance = Callable[[str, float], None]

PICTURES = "pictures"
"""Folder of the stills."""

READ = 0.9
"""Part of the work that is done when the stills are chosen."""

_STILL = "still of a recording"
_JOINTS_TABLE = ("joints.csv", "joints of pictures")
_POSES_TABLE = ("poses.csv", "poses of pictures")
_STILLS_TABLE = ("stills.csv", "stand-stills of a recording")
_LENS_FILE = ("lens_of_bag.yaml", "lens of a bag")


@dataclass(frozen=True)
class Taken:
    """The folder that the stills of a recording were written into."""

    pictures: Path
    table: Path | None  # None where nothing is known of the arm
    lens: Path | None
    said: str  # how many stills were taken, and why no others, in a line
    notes: tuple[str, ...] = ()


@dataclass(eq=False)
class StillsFolder:
    """Writes the stills and their tables into the output folder, and nothing beside it."""

    results: Results
    source: str  # topic or file of the pictures, in words
    of_poses: bool = False  # whether the table is of poses of the flange

    def __post_init__(self) -> None:
        own = self.results
        # they are of the recording alone: another cell takes the same ones
        self._own = Results(own.folder, own.command, (), own.overwrite, own.say)
        self.folder = own.folder / PICTURES
        self._pictures = Results(self.folder, own.command, (), own.overwrite, own.say)
        others = [path.name for path in self._there() if not self._is_still(path)]
        if others:
            raise OutputError(
                f"{self.folder} holds other pictures: {a_few(others)}",
                hint="name another output folder: `out`",
                name=str(self.folder),
            )
        tables = (_JOINTS_TABLE, _POSES_TABLE)
        table, self._other = tables[::-1] if self.of_poses else tables
        (self._table,) = self._own.claim("measured", table)
        (self._list,) = self._own.claim("computed", _STILLS_TABLE)
        (self._lens,) = self._own.claim("measured", _LENS_FILE)

    def _there(self) -> list[Path]:
        if not self.folder.is_dir():
            return []
        return sorted(p for p in self.folder.iterdir() if p.suffix.casefold() in ENDINGS)

    @staticmethod
    def _is_still(path: Path) -> bool:
        origin = origin_of(path)
        return origin is not None and origin.purpose == _STILL

    def pictures(self, pictures: Iterable[GreyImage], count: int, advance: Advance) -> list[str]:
        """Write the pictures of the stills in their order; return their names."""
        names = [f"P{k + 1:03d}.png" for k in range(count)]
        folder_inside(self.folder)
        claims = self._pictures.claim("measured", *((name, _STILL) for name in names))
        for k, (claim, picture) in enumerate(zip(claims, pictures, strict=True)):
            advance(claim.path.name, READ + (1.0 - READ) * k / count)
            data = io.BytesIO()
            Image.fromarray(picture).save(data, "PNG")
            write_bytes_atomic(claim, data.getvalue())
        old = [path.name for path in self._there() if path.name not in names]
        self._pictures.remove(*((name, _STILL) for name in old))
        return names

    def arm_table(
        self,
        names: Sequence[str],
        seconds: FloatArray,
        arm: ArmStream,
        rows: Sequence[int],
        robot: Robot | None,
    ) -> Path:
        """Write joints or poses of the stills."""
        columns, cells = _cells_of(arm, robot)
        listed = [
            {
                "picture": name,
                "taken_s": round(at, 6),
                **dict(zip(columns, cells(row), strict=True)),
            }
            for name, at, row in zip(names, seconds.tolist(), rows, strict=True)
        ]
        return self._write(["picture", *columns, "taken_s"], listed)

    def record(
        self,
        names: Sequence[str],
        seconds: FloatArray,
        arm: ArmStream,
        arm_seconds: FloatArray,
        robot: Robot | None,
    ) -> Path:
        """Write the pictures with their times, and the record of the arm about them."""
        columns, cells = _cells_of(arm, robot)
        near = np.zeros(len(arm_seconds), dtype=bool)
        for at in seconds.tolist():
            near |= np.abs(arm_seconds - at) <= NEAR_S
        listed: list[dict[str, object]] = [
            {"picture": name, "time_s": round(at, 6)}
            for name, at in zip(names, seconds.tolist(), strict=True)
        ]
        listed += [
            {
                "time_s": round(float(arm_seconds[row]), 6),
                **dict(zip(columns, cells(row), strict=True)),
            }
            for row in np.flatnonzero(near).tolist()
        ]
        return self._write(["picture", "time_s", *columns], listed)

    def _write(self, columns: Sequence[str], rows: Sequence[dict[str, object]]) -> Path:
        self._own.remove(self._other)
        return write_table(self._table, columns, rows)

    def rows_of(self, table: Table, names: Sequence[str], rows: Sequence[Row]) -> Path:
        """Write rows of a table with their pictures, in the words of the table."""
        dropped = ("time_s", "frame")
        columns = [name for name in table.columns if name not in dropped]
        listed: list[dict[str, object]] = [
            {"picture": name, **{column: as_read(row.cells[column]) for column in columns}}
            for name, row in zip(names, rows, strict=True)
        ]
        return self._write(["picture", *columns], listed)

    def done(
        self,
        stands: Sequence[StandStill],
        seconds: FloatArray,
        faults: Sequence[CalibError],
        table: Path | None,
        lens: Lens | None,
        notes: Sequence[str],
    ) -> Taken:
        """Write the list of stand-stills and the lens; return all with what is to be said."""
        stills = 0
        listed: list[dict[str, object]] = []
        for one in stands:
            stills += one.picture >= 0
            shown = {"picture": f"P{stills:03d}.png", "taken_s": round(seconds[one.picture], 6)}
            listed.append(
                {
                    "begin_s": round(one.begin_s, 3),
                    "end_s": round(one.end_s, 3),
                    **(shown if one.picture >= 0 else {}),
                    "reason": one.reason,
                }
            )
        write_table(self._list, ["begin_s", "end_s", "picture", "taken_s", "reason"], listed)
        why = why_not(stands)
        said = (
            f"{stills} stills of {len(seconds)} pictures of {self.source} are in {self.folder}"
            + (f"; of {len(stands) - stills} more stand-stills none: {why}" if why else "")
        )
        if faults:
            notes = [*notes, f"{len(faults)} pictures are passed over: {faults[0].message}"]
        file = None
        if lens is not None:
            file = write_text_atomic(self._lens, camera_info(lens))
        else:
            self._own.remove(_LENS_FILE)
        return Taken(self.folder, table, file, said, tuple(notes))


def _cells_of(
    arm: ArmStream, robot: Robot | None
) -> tuple[list[str], Callable[[int], list[object]]]:
    """Columns of joints or poses of an arm, and the cells of a row."""
    joints, poses = arm.joints, arm.T_base_flange
    if joints is not None and robot is not None:
        held = {joint.name: joint for joint in robot.held if joint.name in arm.held}
        names = [f"{name}_{'m' if joint.slides else 'rad'}" for name, joint in held.items()]

        def joint_cells(row: int) -> list[object]:
            more = [AsItIs(f"{arm.held[name][row]:.{RADIAN_DECIMALS}f}") for name in held]
            return [*cells_of(JointForm.ROS, robot, joints[row]), *more]

        return [*columns_of(JointForm.ROS, robot), *names], joint_cells
    if poses is None:
        raise InputError("an arm has neither joints nor poses", name="arm")

    def pose_cells(row: int) -> list[object]:
        T = poses[row]
        return [*(1e3 * T[:3, 3]).tolist(), *quaternion_from_rotation(T[:3, :3]).tolist()]

    return ["x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz"], pose_cells
