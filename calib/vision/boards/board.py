"""Calibration boards: what is printed on them, and where their points are.

The frame of a board is OpenCV's for that kind: x to the right along the print, y down, z into the
board, away from who looks at it. A board that a camera looks at squarely has the axes of the
camera. Its origin is

- for ChArUco the left upper corner of the left upper square,
- for grids of markers the left upper corner of the left upper marker,
- for a chessboard the first inner corner, one square right of and below the left upper corner,
- for grids of circles the centre of the left upper circle,
- for a round target the middle of its circle.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import MISSING, dataclass, fields
from functools import cached_property
from typing import ClassVar

import cv2
import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError, check_type, near_names
from calib.se3 import BoolArray, FloatArray

DICTIONARIES = tuple(
    name
    for name in sorted(dir(cv2.aruco))
    if name.startswith("DICT_") and name == name.upper()  # 36h11 and 36H11 are the same
)
"""Names of the dictionaries of markers, as OpenCV has them."""

APRILTAG = "DICT_APRILTAG_36H11"
"""Dictionary of AprilTag grids where no other is given."""

MOST_ACROSS = 100
"""Squares, markers or circles along a side."""

Print = tuple[FloatArray, FloatArray]
"""What is black: rectangles ``(M, 4)`` of left, top, right and bottom, and discs ``(D, 3)`` of
centre and radius [m] in the board's frame."""


@dataclass(frozen=True, eq=False)
class Board(ABC):
    """A flat calibration board, black on white."""

    name: ClassVar[str]
    """Kind of the board, as :func:`make_board` takes it."""

    @property
    @abstractmethod
    def points(self) -> FloatArray:
        """Corners or centres that can be seen ``(K, 3)`` [m] in the board's frame, with z = 0."""

    @property
    @abstractmethod
    def printed(self) -> Print:
        """What is black on the board."""

    @property
    @abstractmethod
    def box(self) -> FloatArray:
        """Left, top, right and bottom of the printed pattern ``(4,)`` [m] in its frame."""

    @property
    def extent(self) -> FloatArray:
        """What has to be in the picture of a board that is found whole ``(E, 3)`` [m]."""
        return self.points

    @property
    @abstractmethod
    def cell_m(self) -> float:
        """Distance between neighbouring points [m]."""

    @property
    @abstractmethod
    def clear_m(self) -> tuple[float, float]:
        """How far the edges at a point run on, and how far beside them nothing else is [m]."""

    @property
    @abstractmethod
    def words(self) -> str:
        """The board in words, lengths in mm."""

    @property
    def cut_out(self) -> FloatArray:
        """Rectangles ``(C, 4)`` [m] that are white in what is black."""
        return np.empty((0, 4))

    @property
    def ambiguous_half_turn(self) -> bool:
        """Whether the board looks the same after half a turn about its normal."""
        return False

    def is_black(self, xy: FloatArray) -> BoolArray:
        """Whether points ``(N, 2)`` [m] in the board's frame are black ``(N,)``."""
        rectangles, discs = self.printed
        black = _in_rectangles(xy, rectangles)
        for x, y, radius in discs:
            black |= ((xy - [x, y]) ** 2).sum(axis=1) < radius**2
        return black & ~_in_rectangles(xy, self.cut_out)

    @cached_property
    def quadrants(self) -> FloatArray:
        """Blackness ``(K, 2, 2)`` of the quarters about each point: [k, 1, 0] is right above."""
        step = min(self.clear_m) / 4 * np.array([-1.0, 1.0])
        x, y = self.points[:, 0], self.points[:, 1]
        shape = (len(x), 2, 2)
        across = np.broadcast_to(x[:, None, None] + step[:, None], shape)
        down = np.broadcast_to(y[:, None, None] + step, shape)
        quarters = np.stack([across.ravel(), down.ravel()], axis=1)
        return self.is_black(quarters).astype(float).reshape(shape)

    @property
    def size_m(self) -> tuple[float, float]:
        """Width and height of the printed pattern [m]."""
        left, top, right, bottom = self.box.tolist()
        return right - left, bottom - top

    @property
    def outline(self) -> FloatArray:
        """Corners of the printed pattern ``(4, 3)`` [m], clockwise from the left upper one."""
        left, top, right, bottom = self.box
        corners = [[left, top], [right, top], [right, bottom], [left, bottom]]
        return np.column_stack([np.array(corners), np.zeros(4)])


@dataclass(frozen=True, eq=False, kw_only=True)
class GridBoard(Board):
    """A board of rows and columns."""

    columns: int
    rows: int
    """columns, rows: squares of ChArUco and chessboards, markers, or circles, across and down."""

    def __post_init__(self) -> None:
        for key in ("columns", "rows"):
            _check_count(getattr(self, key), key, self.name, least=1)


@dataclass(frozen=True, eq=False, kw_only=True)
class MarkerBoard(GridBoard):
    """A board with markers, each of which tells which one it is."""

    border_bits: ClassVar[int] = 1
    """Width of the black border of a marker, in its cells."""

    marker_m: float  # side of the black square of a marker
    dictionary: str  # one of :data:`DICTIONARIES`
    first_id: int = 0  # number of the left upper marker; the others count on, row by row

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_length(self.marker_m, "marker_m")
        if self.dictionary not in DICTIONARIES:
            raise InputError(
                f"there is no dictionary {self.dictionary!r}",
                hint=near_names(self.dictionary, DICTIONARIES),
                name="dictionary",
            )
        _check_count(self.first_id, "first_id", self.name, least=0, most=10_000)

    @property
    @abstractmethod
    def marker_places(self) -> FloatArray:
        """Left upper corners of the markers ``(M, 2)`` [m]."""

    @property
    def marker_corners(self) -> FloatArray:
        """Corners of the markers ``(M, 4, 2)`` [m], clockwise from the left upper one."""
        square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
        return np.asarray(self.marker_places[:, None] + self.marker_m * square)

    @property
    def ids(self) -> range:
        """Numbers of the markers."""
        return range(self.first_id, self.first_id + len(self.marker_places))

    @property
    def markers(self) -> cv2.aruco.Dictionary:
        """The dictionary itself."""
        return dictionary_of(self.dictionary)

    def _check_ids(self) -> None:
        known = len(self.markers.bytesList)
        if self.ids.stop > known:
            raise InputError(
                f"the board has markers {self.ids.start} to {self.ids.stop - 1}, "
                f"{self.dictionary} has {known}",
                hint="take a larger dictionary, fewer markers or another first_id",
                name="dictionary",
            )

    def _printed_markers(self) -> FloatArray:
        """Rectangles ``(M, 4)`` that are black in the markers."""
        cells = self.markers.markerSize + 2 * self.border_bits
        side = self.marker_m / cells
        found = []
        for place, number in zip(self.marker_places, self.ids, strict=True):
            bits = self.markers.generateImageMarker(number, cells, None, self.border_bits) == 0
            found.append(side * _runs(bits) + np.tile(place, 2))
        return np.vstack(found)

    @property
    def _marker_words(self) -> str:
        return (
            f"markers {self.ids.start} to {self.ids.stop - 1} of {self.dictionary}, "
            f"{1e3 * self.marker_m:g} mm"
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class CharucoBoard(MarkerBoard):
    """A chessboard with markers in its white squares."""

    name: ClassVar[str] = "charuco"
    square_m: float  # side of the squares
    legacy: bool = False
    """The pattern of OpenCV before 4.6: with an even number of rows the left upper square is white
    and has a marker."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_length(self.square_m, "square_m")
        if not self.marker_m < self.square_m:
            raise InputError(
                f"markers of {1e3 * self.marker_m:g} mm do not go into squares of "
                f"{1e3 * self.square_m:g} mm",
                hint="markers are smaller than squares: 0.7 to 0.8 of them is usual",
                name="marker_m",
            )
        if min(self.columns, self.rows) < 2 or self.columns * self.rows < 6:
            raise InputError(
                f"a ChArUco board of {self.columns} x {self.rows} squares has "
                f"{(self.columns - 1) * (self.rows - 1)} inner corners",
                hint="columns and rows count squares: take 3 x 3 at least",
                name="columns",
            )
        self._check_ids()

    @cached_property
    def points(self) -> FloatArray:
        """Inner corners ``(K, 3)`` [m], row by row."""
        return _lattice(self.columns - 1, self.rows - 1, self.square_m, (1.0, 1.0))

    @cached_property
    def marker_places(self) -> FloatArray:
        margin = (self.square_m - self.marker_m) / 2
        white = ~_checks(self.columns, self.rows, self._first_is_black)
        rows, columns = np.nonzero(white)
        return np.asarray(self.square_m * np.stack([columns, rows], axis=1) + margin)

    @property
    def _first_is_black(self) -> bool:
        return not (self.legacy and self.rows % 2 == 0)

    @cached_property
    def printed(self) -> Print:
        squares = _squares(self.columns, self.rows, self.square_m, self._first_is_black)
        return np.vstack([squares, self._printed_markers()]), np.empty((0, 3))

    @property
    def box(self) -> FloatArray:
        return np.array([0.0, 0.0, self.columns * self.square_m, self.rows * self.square_m])

    @property
    def cell_m(self) -> float:
        return self.square_m

    @property
    def clear_m(self) -> tuple[float, float]:
        """Half a square along its sides, and the white about its marker.

        Markers lie on both sides of an edge by turns, so what is seen of them cancels out.
        """
        white = (self.square_m - self.marker_m) / 2
        return 0.45 * self.square_m, max(0.9 * white, 0.12 * self.square_m)

    @property
    def words(self) -> str:
        return (
            f"ChArUco board of {self.columns} x {self.rows} squares of "
            f"{1e3 * self.square_m:g} mm, {self._marker_words}" + ", legacy pattern" * self.legacy
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class MarkerGrid(MarkerBoard):
    """Rows and columns of markers."""

    title: ClassVar[str]
    spacing_m: float  # from the left side of a marker to that of the next

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_length(self.spacing_m, "spacing_m")
        if not self.marker_m < self.spacing_m:
            raise InputError(
                f"markers of {1e3 * self.marker_m:g} mm do not go side by side every "
                f"{1e3 * self.spacing_m:g} mm",
                hint="spacing is from marker to marker, the white between them included",
                name="spacing_m",
            )
        self._check_ids()

    @cached_property
    def points(self) -> FloatArray:
        """Corners of the markers ``(K, 3)`` [m], four for each, clockwise from left upper."""
        corners = self.marker_corners.reshape(-1, 2)
        return np.column_stack([corners, np.zeros(len(corners))])

    @cached_property
    def marker_places(self) -> FloatArray:
        return _lattice(self.columns, self.rows, self.spacing_m)[:, :2]

    @cached_property
    def printed(self) -> Print:
        return self._printed_markers(), np.empty((0, 3))

    @property
    def box(self) -> FloatArray:
        across, down = (self.spacing_m * (n - 1) for n in (self.columns, self.rows))
        return np.array([0.0, 0.0, across + self.marker_m, down + self.marker_m])

    @property
    def cell_m(self) -> float:
        """Side of a marker, or the white between two [m]."""
        return min(self.marker_m, self.spacing_m - self.marker_m)

    @property
    def clear_m(self) -> tuple[float, float]:
        """Half a side, and the black border of a marker or the white between two."""
        border = self.border_bits * self.marker_m / (self.markers.markerSize + 2 * self.border_bits)
        return 0.45 * self.marker_m, 0.9 * min(border, self.spacing_m - self.marker_m)

    @property
    def words(self) -> str:
        return (
            f"{self.title} of {self.columns} x {self.rows} every {1e3 * self.spacing_m:g} mm, "
            f"{self._marker_words}"
        )


class ArucoGrid(MarkerGrid):
    """Rows and columns of ArUco markers."""

    name: ClassVar[str] = "aruco-grid"
    title: ClassVar[str] = "ArUco grid"


class AprilTagGrid(MarkerGrid):
    """Rows and columns of AprilTags."""

    name: ClassVar[str] = "apriltag-grid"
    title: ClassVar[str] = "AprilTag grid"


class KalibrAprilGrid(AprilTagGrid):
    """The AprilGrid of Kalibr: borders of two cells, and black squares between the corners of tags.

    Its first tag is the left lower one. Kalibr's frame has the origin at the left lower corner of
    that tag and y up; ours is that of all grids. Source: the wiki of Kalibr, "calibration targets".
    """

    name: ClassVar[str] = "kalibr-aprilgrid"
    title: ClassVar[str] = "AprilGrid of Kalibr"
    border_bits: ClassVar[int] = 2

    @cached_property
    def marker_places(self) -> FloatArray:
        """Left upper corners of the tags ``(M, 2)`` [m], rows from below."""
        rows = _lattice(self.columns, self.rows, self.spacing_m)[:, :2]
        return rows.reshape(self.rows, self.columns, 2)[::-1].reshape(-1, 2)

    @cached_property
    def printed(self) -> Print:
        gap = self.spacing_m - self.marker_m
        squares = _lattice(self.columns + 1, self.rows + 1, self.spacing_m)[:, :2] - gap
        return np.vstack([self._printed_markers(), np.hstack([squares, squares + gap])]), np.empty(
            (0, 3)
        )

    @property
    def box(self) -> FloatArray:
        gap = self.spacing_m - self.marker_m
        return np.asarray(super().box + gap * np.array([-1.0, -1.0, 1.0, 1.0]))

    @property
    def clear_m(self) -> tuple[float, float]:
        """The side of a square, which an edge ends with, and what is clear beside it."""
        gap = self.spacing_m - self.marker_m
        along, across = super().clear_m
        return min(along, 0.9 * gap), across


@dataclass(frozen=True, eq=False, kw_only=True)
class Chessboard(GridBoard):
    """A chessboard; its left upper square is black."""

    name: ClassVar[str] = "chessboard"
    square_m: float

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_length(self.square_m, "square_m")
        if min(self.columns, self.rows) < 4:
            raise InputError(
                f"a chessboard of {self.columns} x {self.rows} squares is too small to be found",
                hint="columns and rows count squares, not inner corners: 4 x 4 at least",
                name="columns",
            )
        if self.columns == self.rows and self.columns % 2:
            _refuse_quarter_turn(self, "squares")

    @property
    def ambiguous_half_turn(self) -> bool:
        """Whether opposite corner squares have the same colour."""
        return (self.columns + self.rows) % 2 == 0

    @cached_property
    def points(self) -> FloatArray:
        """Inner corners ``(K, 3)`` [m], row by row."""
        return _lattice(self.columns - 1, self.rows - 1, self.square_m)

    @cached_property
    def printed(self) -> Print:
        squares = _squares(self.columns, self.rows, self.square_m, True) - self.square_m
        return squares, np.empty((0, 3))

    @property
    def box(self) -> FloatArray:
        return self.square_m * np.array([-1.0, -1.0, self.columns - 1, self.rows - 1])

    @property
    def cell_m(self) -> float:
        return self.square_m

    @property
    def clear_m(self) -> tuple[float, float]:
        return 0.45 * self.square_m, 0.45 * self.square_m

    @property
    def words(self) -> str:
        return (
            f"chessboard of {self.columns} x {self.rows} squares of {1e3 * self.square_m:g} mm "
            f"({self.columns - 1} x {self.rows - 1} inner corners)"
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class CircleGrid(GridBoard):
    """Rows and columns of black circles, spaced from centre to centre, across and down."""

    name: ClassVar[str] = "circles"
    spacing_m: float
    diameter_m: float

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_length(self.spacing_m, "spacing_m")
        _check_length(self.diameter_m, "diameter_m")
        if min(self.columns, self.rows) < 3:
            raise InputError(
                f"{self.columns} x {self.rows} circles are too few to be told from others",
                hint="take 3 x 3 at least",
                name="columns",
            )
        if not self.diameter_m < 0.9 * self.cell_m:
            raise InputError(
                f"circles of {1e3 * self.diameter_m:g} mm are {1e3 * self.cell_m:.4g} mm apart",
                hint="leave white between them: half the distance is a good diameter",
                name="diameter_m",
            )
        self._check_order()

    def _check_order(self) -> None:
        if self.columns == self.rows:
            _refuse_quarter_turn(self, "circles")

    @property
    def ambiguous_half_turn(self) -> bool:
        """A grid of circles always looks the same after half a turn."""
        return True

    @cached_property
    def points(self) -> FloatArray:
        """Centres ``(K, 3)`` [m], row by row."""
        return _lattice(self.columns, self.rows, self.spacing_m)

    @cached_property
    def printed(self) -> Print:
        discs = self.points.copy()
        discs[:, 2] = self.diameter_m / 2
        return np.empty((0, 4)), discs

    @property
    def extent(self) -> FloatArray:
        return _rims(self.printed[1], 4)

    @property
    def box(self) -> FloatArray:
        low, high = self.points[:, :2].min(axis=0), self.points[:, :2].max(axis=0)
        return np.concatenate([low - self.diameter_m / 2, high + self.diameter_m / 2])

    @property
    def cell_m(self) -> float:
        return self.spacing_m

    @property
    def clear_m(self) -> tuple[float, float]:
        """The whole circle, and what is inside or between circles."""
        return self.diameter_m, 0.45 * min(self.diameter_m, self.cell_m - self.diameter_m)

    @property
    def words(self) -> str:
        return (
            f"grid of {self.columns} x {self.rows} circles of {1e3 * self.diameter_m:g} mm every "
            f"{1e3 * self.spacing_m:g} mm"
        )


class AsymmetricCircleGrid(CircleGrid):
    """Rows of black circles, every second one moved to the right by half a step.

    ``spacing_m`` is the distance of the rows, and half of that from centre to centre in a row.
    """

    name: ClassVar[str] = "asymmetric-circles"

    def _check_order(self) -> None:
        """A half turn is all that can be hidden: rows and columns are not at the same distance."""

    @property
    def ambiguous_half_turn(self) -> bool:
        """Whether the number of rows is even: first and last row then change places."""
        return self.rows % 2 == 0

    @cached_property
    def points(self) -> FloatArray:
        """Centres ``(K, 3)`` [m], row by row."""
        row, column = np.divmod(np.arange(self.rows * self.columns), self.columns)
        grid = np.stack([2 * column + row % 2, row, np.zeros_like(row)], axis=1)
        return np.asarray(self.spacing_m * grid)

    @property
    def cell_m(self) -> float:
        """Distance between neighbours, which are diagonal [m]."""
        return float(np.sqrt(2.0)) * self.spacing_m

    @property
    def words(self) -> str:
        return (
            f"asymmetric grid of {self.rows} rows of {self.columns} circles of "
            f"{1e3 * self.diameter_m:g} mm, rows {1e3 * self.spacing_m:g} mm apart"
        )


@dataclass(frozen=True, eq=False)
class RoundTarget(Board):
    """A black circle with a white cross in it, and white squares beside three of its corners.

    The corner without a square, right below, tells which way is up. Points are the corners of cross
    and squares. The middle of the circle is none: perspective and the lens move the middle of so
    large an ellipse, and edges that meet in a corner they do not.
    """

    name: ClassVar[str] = "round-target"
    diameter_m: float

    def __post_init__(self) -> None:
        _check_length(self.diameter_m, "diameter_m")

    @cached_property
    def points(self) -> FloatArray:
        """Corners of the cross, then of the squares ``(24, 3)`` [m], all clockwise."""
        long, half = _CROSS
        arm = np.array([[half, -half], [long, -half], [long, half]])
        cross = [arm @ turn for turn in QUARTER_TURNS]
        corners = self.cut_out[2:, [0, 1, 2, 1, 2, 3, 0, 3]].reshape(-1, 2)
        xy = np.vstack([self.diameter_m * np.vstack(cross), corners])
        return np.column_stack([xy, np.zeros(len(xy))])

    @property
    def printed(self) -> Print:
        return np.empty((0, 4)), np.array([[0.0, 0.0, self.diameter_m / 2]])

    @property
    def cut_out(self) -> FloatArray:
        (long, half), (near, far) = _CROSS, _SQUARE
        bars = [[-long, -half, long, half], [-half, -long, half, long]]
        squares = [[-far, near, -near, far], [-far, -far, -near, -near], [near, -far, far, -near]]
        return self.diameter_m * np.array(bars + squares)

    @property
    def extent(self) -> FloatArray:
        return _rims(self.printed[1], 24)

    @property
    def box(self) -> FloatArray:
        return self.diameter_m / 2 * np.array([-1.0, -1.0, 1.0, 1.0])

    @property
    def cell_m(self) -> float:
        return 2 * _CROSS[1] * self.diameter_m

    @property
    def clear_m(self) -> tuple[float, float]:
        """Half the end of a bar, and half of what is between a bar and a square."""
        return 0.45 * self.cell_m, 0.45 * (_SQUARE[0] - _CROSS[1]) * self.diameter_m

    @property
    def words(self) -> str:
        return f"round target of {1e3 * self.diameter_m:g} mm with a cross and three squares"


_CROSS, _SQUARE = (0.36, 0.06), (0.16, 0.29)
"""Half length and half width of the bars; how far the squares begin and end off both axes: in
diameters. Wherever edges face each other, a tenth of the diameter or more is between them."""

QUARTER_TURNS = [np.linalg.matrix_power(np.array([[0, 1], [-1, 0]]), k) for k in range(4)]
"""Of row vectors, clockwise as y is down."""

BOARDS: dict[str, type[Board]] = {
    kind.name: kind
    for kind in (
        CharucoBoard, ArucoGrid, AprilTagGrid, KalibrAprilGrid, Chessboard, CircleGrid,
        AsymmetricCircleGrid, RoundTarget,
    )
}  # fmt: skip
"""Kinds of boards by their names."""


def make_board(
    kind: str,
    *,
    columns: int | None = None,
    rows: int | None = None,
    square_m: float | None = None,
    spacing_m: float | None = None,
    marker_m: float | None = None,
    diameter_m: float | None = None,
    dictionary: str | None = None,
    first_id: int | None = None,
    legacy: bool = False,
) -> Board:
    """The board of a kind, all that belongs to it given.

    Parameters
    ----------
    kind : str
        One of :data:`BOARDS`.
    columns, rows : int, optional
        Across and down: squares of ``charuco`` and ``chessboard``, not their inner corners;
        markers; circles. A ``round-target`` has none.
    square_m : float, optional
        Side of a square of ``charuco`` and ``chessboard``.
    spacing_m : float, optional
        From marker to marker, or from circle to circle; for ``asymmetric-circles`` from row to row.
    marker_m : float, optional
        Side of the black square of a marker.
    diameter_m : float, optional
        Of circles, where half the distance of neighbours is the default; of a ``round-target``.
    dictionary : str, optional
        Of the markers, one of :data:`DICTIONARIES`, without ``DICT_`` if you like; that of
        AprilTag grids is 36h11 by default.
    first_id : int, optional
        Number of the first marker; 0 by default.
    legacy : bool
        A ``charuco`` as OpenCV before 4.6 has it.

    Raises
    ------
    InputError
        An unknown kind or dictionary, something missing or of another kind, or a board that
        cannot be.
    """
    check_type(kind, str, "kind")
    if kind not in BOARDS:
        raise InputError(
            f"there is no board {kind!r}", hint=near_names(kind, BOARDS), name="kind", value=kind
        )
    given: dict[str, object] = {
        "columns": columns, "rows": rows, "square_m": square_m, "spacing_m": spacing_m,
        "marker_m": marker_m, "diameter_m": diameter_m, "dictionary": dictionary,
        "first_id": first_id, "legacy": legacy or None,
    }  # fmt: skip
    values = {key: value for key, value in given.items() if value is not None}
    board = BOARDS[kind]
    if issubclass(board, MarkerBoard):
        values["dictionary"] = _dictionary_name(kind, dictionary)
    elif issubclass(board, CircleGrid) and diameter_m is None and spacing_m is not None:
        _check_length(spacing_m, "spacing_m")
        near = np.sqrt(2.0) if board is AsymmetricCircleGrid else 1.0
        values["diameter_m"] = float(near * spacing_m / 2)
    for field in fields(board):
        if field.name not in values and field.default is MISSING:
            raise InputError(f"a {kind} needs {field.name}", hint="give it", name=field.name)
    known = {field.name for field in fields(board)}
    for key in values:
        if key not in known:
            raise InputError(f"a {kind} has no {key}", hint="leave it out", name=key)
    return board(**values)


def dictionary_of(name: str) -> cv2.aruco.Dictionary:
    """A dictionary of OpenCV by its name."""
    return cv2.aruco.getPredefinedDictionary(int(getattr(cv2.aruco, name)))


def _dictionary_name(kind: str, given: object) -> str:
    if given is None:
        if issubclass(BOARDS[kind], AprilTagGrid):
            return APRILTAG
        raise InputError(
            f"a {kind} needs the dictionary of its markers",
            hint="for example DICT_5X5_100; it stands on most boards",
            name="dictionary",
        )
    check_type(given, str, "dictionary")
    name = str(given).upper().replace("-", "_")
    for full in (name, f"DICT_{name}", f"DICT_APRILTAG_{name}", f"DICT_ARUCO_{name}"):
        if full in DICTIONARIES:
            return full
    raise InputError(
        f"there is no dictionary {given!r}",
        hint=near_names(f"DICT_{name.removeprefix('DICT_')}", DICTIONARIES),
        name="dictionary",
    )


def _refuse_quarter_turn(board: GridBoard, what: str) -> None:
    raise InputError(
        f"a board of {board.columns} x {board.rows} {what} looks the same after a quarter turn",
        hint="take one more column than rows",
        name="columns",
    )


def _check_count(
    value: object, key: str, kind: str, *, least: int, most: int = MOST_ACROSS
) -> None:
    whole = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    if not whole or not least <= int(value) <= most:  # type: ignore[call-overload]
        raise InputError(
            f"{key} of the {kind} is {value!r}",
            hint=f"give a whole number from {least} to {most}",
            name=key,
        )


def _check_length(value: object, key: str) -> None:
    number = isinstance(value, (int, float, np.floating)) and not isinstance(value, bool)
    if number and 1e-4 <= float(value) <= 10.0:  # type: ignore[arg-type]
        return
    said = f"{1e3 * float(value):g} mm" if number else repr(value)  # type: ignore[arg-type]
    raise InputError(
        f"{key} of the board is {said}",
        hint="lengths of boards are from 0.1 mm to 10 m",
        name=key,
    )


def _lattice(
    columns: int, rows: int, step: float, first: tuple[float, float] = (0.0, 0.0)
) -> FloatArray:
    """Points ``(rows * columns, 3)``, row by row."""
    row, column = np.divmod(np.arange(rows * columns), columns)
    grid = [column + first[0], row + first[1], np.zeros(rows * columns)]
    return np.asarray(step * np.stack(grid, axis=1))


def _checks(columns: int, rows: int, first: bool) -> BoolArray:
    """Which squares ``(rows, columns)`` are black."""
    return np.asarray((np.add.outer(np.arange(rows), np.arange(columns)) % 2 == 0) == first)


def _squares(columns: int, rows: int, side: float, first: bool) -> FloatArray:
    row, column = np.nonzero(_checks(columns, rows, first))
    return np.asarray(side * np.stack([column, row, column + 1, row + 1], axis=1))


def _rims(discs: FloatArray, count: int) -> FloatArray:
    """Points ``(D * count, 3)`` evenly about discs."""
    angle = 2.0 * np.pi * np.arange(count) / count
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    rims = (discs[:, None, :2] + discs[:, None, 2:] * circle).reshape(-1, 2)
    return np.column_stack([rims, np.zeros(len(rims))])


def _in_rectangles(xy: FloatArray, rectangles: FloatArray) -> BoolArray:
    x, y = xy.T
    inside = np.zeros(len(xy), dtype=bool)
    for left, top, right, bottom in rectangles:
        inside |= (x >= left) & (x < right) & (y >= top) & (y < bottom)
    return inside


def _runs(black: ArrayLike) -> FloatArray:
    """Rectangles ``(M, 4)`` in cells that are black together: runs of each row."""
    padded = np.pad(np.asarray(black, dtype=np.int8), ((0, 0), (1, 1)))
    step = np.diff(padded, axis=1)
    row, left = np.nonzero(step == 1)
    right = np.nonzero(step == -1)[1]
    return np.stack([left, row, right, row + 1], axis=1).astype(float)
