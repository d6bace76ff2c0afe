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

from collections.abc import Sequence
from dataclasses import MISSING, dataclass, field, fields, replace
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


_NOTHING = np.empty((0, 4))


@dataclass(frozen=True, eq=False)
class Board:
    """A flat calibration board, black on white; lengths in m, in its own frame."""

    name: ClassVar[str]
    """Kind of the board, as :func:`make_board` takes it."""

    points: FloatArray = field(init=False, repr=False)
    """Corners or centres that can be seen ``(K, 3)``, with z = 0."""
    box: FloatArray = field(init=False, repr=False)
    """Left, top, right and bottom of the printed pattern ``(4,)``."""
    cell_m: float = field(init=False, repr=False)  # distance between neighbouring points
    clear_m: tuple[float, float] = field(init=False, repr=False)
    """How far the edges at a point run on, and how far beside them nothing else is."""
    words: str = field(init=False, repr=False)  # the board in words, lengths in mm
    step_m: tuple[float, float] = field(init=False, repr=False)
    """Distance after which the lattice of the board repeats, along x and along y."""
    ambiguous_half_turn: bool = field(init=False, repr=False)
    """Whether the board looks the same after half a turn about its normal."""
    cut_out: FloatArray = field(init=False, repr=False)
    """Rectangles ``(C, 4)`` that are white in what is black."""
    _black: Print = field(init=False, repr=False)  # but for what is in markers

    def __post_init__(self) -> None:
        for own in fields(self):
            if own.init and own.name.endswith("_m") and getattr(self, own.name) is not None:
                _check_length(getattr(self, own.name), own.name)

    def _draw(
        self,
        xy: FloatArray,
        *,
        box: ArrayLike,
        cell_m: float,
        clear_m: tuple[float, float],
        step_m: tuple[float, float],
        words: str,
        rectangles: FloatArray = _NOTHING,
        discs: FloatArray = _NOTHING[:, :3],
        cut_out: FloatArray = _NOTHING,
        ambiguous_half_turn: bool = False,
    ) -> None:
        """Say what is on the board, its points ``(K, 2)`` first."""
        vars(self).update(
            points=_flat(xy),
            box=np.asarray(box),
            cell_m=cell_m,
            clear_m=clear_m,
            step_m=step_m,
            words=words,
            ambiguous_half_turn=ambiguous_half_turn,
            cut_out=cut_out,
            _black=(rectangles, discs),
        )

    @property
    def printed(self) -> Print:
        """What is black on the board."""
        return self._black

    @property
    def extent(self) -> FloatArray:
        """What has to be in the picture of a board that is found whole ``(E, 3)``."""
        discs = self.printed[1]
        if not len(discs):
            return self.points
        count = 4 if len(discs) > 1 else 24
        angle = 2.0 * np.pi * np.arange(count) / count
        circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return _flat((discs[:, None, :2] + discs[:, None, 2:] * circle).reshape(-1, 2))

    def is_black(self, xy: FloatArray) -> BoolArray:
        """Whether points ``(N, 2)`` in the board's frame are black ``(N,)``."""
        rectangles, discs = self.printed
        black = _in_rectangles(xy, rectangles)
        for x, y, radius in discs:
            black |= ((xy - [x, y]) ** 2).sum(axis=1) < radius**2
        return black & ~_in_rectangles(xy, self.cut_out)

    def known_black(self, xy: FloatArray) -> FloatArray:
        """Return 1 where points ``(N, 2)`` are black, 0 where white, NaN inside of markers."""
        return self.is_black(xy).astype(float)

    @cached_property
    def quadrants(self) -> FloatArray:
        """Blackness ``(K, 2, 2)`` of the quarters about each point: [k, 1, 0] is right above."""
        step = min(self.clear_m) / 4 * np.array([-1.0, 1.0])
        aside = np.stack(np.meshgrid(step, step, indexing="ij"), axis=-1)
        quarters = self.points[:, None, None, :2] + aside
        return self.is_black(quarters.reshape(-1, 2)).astype(float).reshape(-1, 2, 2)

    @property
    def size_m(self) -> tuple[float, float]:
        """Width and height of the printed pattern."""
        left, top, right, bottom = self.box.tolist()
        return right - left, bottom - top

    @property
    def outline(self) -> FloatArray:
        """Corners of the printed pattern ``(4, 3)``, clockwise from the left upper one."""
        return _flat(self.box[[[0, 1], [2, 1], [2, 3], [0, 3]]])


@dataclass(frozen=True, eq=False, kw_only=True)
class GridBoard(Board):
    """A board of rows and columns."""

    columns: int
    rows: int
    """columns, rows: squares of ChArUco and chessboards, markers, or circles, across and down."""

    def __post_init__(self) -> None:
        for key in ("columns", "rows"):
            _check_count(getattr(self, key), key, self.name, least=1)
        super().__post_init__()

    def _refuse_quarter_turn(self, what: str, otherwise: str = "") -> None:
        raise InputError(
            f"a board of {self.columns} x {self.rows} {what} looks the same after a quarter turn",
            hint=f"take one more column than rows{otherwise}",
            name="columns",
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class MarkerBoard(GridBoard):
    """A board with markers, each of which tells which one it is."""

    border_bits: ClassVar[int] = 1
    """Width of the black border of a marker, in its cells."""
    is_apriltag: ClassVar[bool] = False
    """True if tags are printed as AprilRobotics and Kalibr print them. OpenCV draws the tags of its
    AprilTag dictionaries turned by 180 degrees against these."""

    marker_m: float  # side of the black square of a marker
    dictionary: str  # one of :data:`DICTIONARIES`
    first_id: int = 0  # number of the left upper marker; the others count on, row by row
    marker_corners: FloatArray = field(init=False, repr=False)
    """Corners of the markers ``(M, 4, 2)``, clockwise from the left upper one."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.dictionary not in DICTIONARIES:
            raise InputError(
                f"there is no dictionary {self.dictionary!r}",
                hint=near_names(self.dictionary, DICTIONARIES),
                name="dictionary",
            )
        _check_count(self.first_id, "first_id", self.name, least=0, most=10_000)

    def _place_markers(self, places: FloatArray) -> str:
        """Markers whose left upper corners are at ``(M, 2)``, and in words which."""
        square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
        vars(self)["marker_corners"] = places[:, None] + self.marker_m * square
        first, last, known = self.first_id, self.ids.stop - 1, len(self.markers.bytesList)
        if last >= known:
            raise InputError(
                f"the board has markers {first} to {last}, {self.dictionary} has {known}",
                hint="take a larger dictionary, fewer markers or another first_id",
                name="dictionary",
            )
        return f"markers {first} to {last} of {self.dictionary}, {1e3 * self.marker_m:g} mm"

    @property
    def ids(self) -> range:
        """Numbers of the markers."""
        return range(self.first_id, self.first_id + len(self.marker_corners))

    @property
    def markers(self) -> cv2.aruco.Dictionary:
        """The dictionary itself."""
        return dictionary_of(self.dictionary)

    @property
    def _cells(self) -> int:
        """Cells along a side of a marker, its border with them."""
        return int(self.markers.markerSize + 2 * self.border_bits)

    @cached_property
    def bits(self) -> BoolArray:
        """Black cells of the markers ``(M, cells, cells)``, their borders with them."""
        cells, border = self._cells, self.border_bits
        drawn = [self.markers.generateImageMarker(k, cells, None, border) == 0 for k in self.ids]
        return np.rot90(np.array(drawn), 2 * self.is_apriltag, axes=(1, 2))

    @cached_property
    def printed(self) -> Print:
        """What is black on the board, the black runs of the rows of its markers with it."""
        black, side = [self._black[0]], self.marker_m / self._cells
        for corners, bits in zip(self.marker_corners, self.bits, strict=True):
            step = np.diff(np.pad(bits.astype(np.int8), ((0, 0), (1, 1))), axis=1)
            row, left = np.nonzero(step == 1)
            runs = np.stack([left, row, np.nonzero(step == -1)[1], row + 1], axis=1)
            black.append(side * runs + np.tile(corners[0], 2))
        return np.vstack(black), self._black[1]

    def known_black(self, xy: FloatArray) -> FloatArray:
        """Return 1 where points ``(N, 2)`` are black, 0 where white, NaN inside of markers."""
        corners, border = self.marker_corners, self.border_bits * self.marker_m / self._cells
        squares = np.hstack([corners[:, 0], corners[:, 2]])
        black = _in_rectangles(xy, np.vstack([self._black[0], squares])).astype(float)
        black[_in_rectangles(xy, squares + border * np.array([1.0, 1.0, -1.0, -1.0]))] = np.nan
        return black


@dataclass(frozen=True, eq=False, kw_only=True)
class CharucoBoard(MarkerBoard):
    """A chessboard with markers in its white squares; points are its inner corners, row by row."""

    name: ClassVar[str] = "charuco"
    square_m: float  # side of the squares
    legacy: bool = False
    """The pattern of OpenCV before 4.6: with an even number of rows the left upper square is white
    and has a marker."""

    def __post_init__(self) -> None:
        super().__post_init__()
        side, columns, rows = self.square_m, self.columns, self.rows
        if not self.marker_m < side:
            raise InputError(
                f"markers of {1e3 * self.marker_m:g} mm do not go into squares of "
                f"{1e3 * side:g} mm",
                hint="markers are smaller than squares: 0.7 to 0.8 of them is usual",
                name="marker_m",
            )
        if min(columns, rows) < 2 or columns * rows < 6:
            raise InputError(
                f"a ChArUco board of {columns} x {rows} squares has "
                f"{(columns - 1) * (rows - 1)} inner corners",
                hint="columns and rows count squares: take 3 x 3 at least",
                name="columns",
            )
        white = (side - self.marker_m) / 2
        first = not (self.legacy and rows % 2 == 0)
        markers = self._place_markers(side * _checks(columns, rows, not first) + white)
        squares = side * _checks(columns, rows, first)
        self._draw(
            side * (_lattice(columns - 1, rows - 1) + 1.0),
            box=[0.0, 0.0, columns * side, rows * side],
            cell_m=side,
            # half a square along its sides, and the white about its marker: markers lie on both
            # sides of an edge by turns, so what is seen of them cancels out
            clear_m=(0.45 * side, max(0.9 * white, 0.12 * side)),
            step_m=(side, side),
            words=f"ChArUco board of {columns} x {rows} squares of {1e3 * side:g} mm, {markers}"
            + ", legacy pattern" * self.legacy,
            rectangles=np.hstack([squares, squares + side]),
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class MarkerGrid(MarkerBoard):
    """Rows and columns of markers; points are their corners, clockwise from the left upper."""

    title: ClassVar[str]
    is_kalibr: ClassVar[bool] = False
    spacing_m: float  # from the left side of a marker to that of the next

    def __post_init__(self) -> None:
        super().__post_init__()
        step, side = self.spacing_m, self.marker_m
        if not side < step:
            raise InputError(
                f"markers of {1e3 * side:g} mm do not go side by side every {1e3 * step:g} mm",
                hint="spacing is from marker to marker, the white between them included",
                name="spacing_m",
            )
        gap, border = step - side, self.border_bits * side / self._cells
        places = step * _lattice(self.columns, self.rows)
        box = np.array([0.0, 0.0, *(places.max(axis=0) + side)])
        along, black = 0.45 * side, _NOTHING
        if self.is_kalibr:
            places = places.reshape(self.rows, self.columns, 2)[::-1].reshape(-1, 2)
            squares = step * _lattice(self.columns + 1, self.rows + 1) - gap
            box, black = box + gap * np.array([-1, -1, 1, 1]), np.hstack([squares, squares + gap])
            along = min(along, 0.9 * gap)  # an edge ends with the side of a square
        markers = self._place_markers(places)
        self._draw(
            self.marker_corners.reshape(-1, 2),
            box=box,
            cell_m=min(side, gap),
            # half a side, and the black border of a marker or the white between two
            clear_m=(along, 0.9 * min(border, gap)),
            step_m=(step, step),
            words=f"{self.title} of {self.columns} x {self.rows} every {1e3 * step:g} mm, "
            + markers,
            rectangles=black,
        )


class ArucoGrid(MarkerGrid):
    """Rows and columns of ArUco markers."""

    name: ClassVar[str] = "aruco-grid"
    title: ClassVar[str] = "ArUco grid"


class AprilTagGrid(MarkerGrid):
    """Rows and columns of AprilTags, upright as AprilRobotics has them."""

    is_apriltag: ClassVar[bool] = True
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
    is_kalibr: ClassVar[bool] = True


@dataclass(frozen=True, eq=False, kw_only=True)
class Chessboard(GridBoard):
    """A chessboard, its left upper square black; points are its inner corners, row by row."""

    name: ClassVar[str] = "chessboard"
    square_m: float
    white_first: bool = False
    """True if the left upper square is white, of a board that no turn makes black there."""

    def __post_init__(self) -> None:
        super().__post_init__()
        columns, rows, side = self.columns, self.rows, self.square_m
        if min(columns, rows) < 4:
            raise InputError(
                f"a chessboard of {columns} x {rows} squares is too small to be found",
                hint="columns and rows count squares, not inner corners: 4 x 4 at least",
                name="columns",
            )
        if columns == rows and columns % 2:
            self._refuse_quarter_turn("squares")
        squares = side * _checks(columns, rows, not self.white_first)
        self._draw(
            side * _lattice(columns - 1, rows - 1),
            box=side * np.array([-1.0, -1.0, columns - 1, rows - 1]),
            cell_m=side,
            clear_m=(0.45 * side, 0.45 * side),
            step_m=(side, side),
            words=f"chessboard of {columns} x {rows} squares of {1e3 * side:g} mm "
            f"({columns - 1} x {rows - 1} inner corners)",
            rectangles=np.hstack([squares - side, squares]),
            ambiguous_half_turn=(columns + rows) % 2 == 0,  # opposite corners are of one colour
        )

    @property
    def variants(self) -> tuple[Chessboard, ...]:
        """The board, and its negative where no turn of the board gives the same picture."""
        if (self.columns + self.rows) % 2 or self.columns == self.rows:
            return (self,)
        return self, replace(self, white_first=not self.white_first)


@dataclass(frozen=True, eq=False, kw_only=True)
class CircleGrid(GridBoard):
    """Rows and columns of black circles, spaced from centre to centre; points are the centres."""

    name: ClassVar[str] = "circles"
    is_asymmetric: ClassVar[bool] = False
    spacing_m: float
    diameter_m: float
    large_dot_m: float | None = None
    """Diameter of the left upper circle of a grid with one large dot: it tells which way is up."""

    def __post_init__(self) -> None:
        super().__post_init__()
        diameter, step, large = self.diameter_m, self.spacing_m, self.large_dot_m
        if min(self.columns, self.rows) < 3:
            raise InputError(
                f"{self.columns} x {self.rows} circles are too few to be told from others",
                hint="take 3 x 3 at least",
                name="columns",
            )
        apart, grid = step, _lattice(self.columns, self.rows)
        size = f"{self.columns} x {self.rows} circles of {1e3 * diameter:g} mm every"
        words, half_turn = f"grid of {size} {1e3 * step:g} mm", True
        if self.is_asymmetric:
            row = grid[:, 1]
            apart, grid = float(np.sqrt(2.0)) * step, np.stack([2 * grid[:, 0] + row % 2, row], 1)
            size = f"{self.rows} rows of {self.columns} circles of {1e3 * diameter:g} mm"
            words = f"asymmetric grid of {size}, rows {1e3 * step:g} mm apart"
            half_turn = self.rows % 2 == 0  # then first and last row change places
        if not diameter < 0.9 * apart:
            raise InputError(
                f"circles of {1e3 * diameter:g} mm are {1e3 * apart:.4g} mm apart",
                hint="leave white between them: half the distance is a good diameter",
                name="diameter_m",
            )
        if large is not None and not 1.1 * diameter < large < 1.8 * apart - diameter:
            raise InputError(
                f"a large dot of {1e3 * large:g} mm beside circles of {1e3 * diameter:g} mm that "
                f"are {1e3 * apart:.4g} mm apart",
                hint="it is larger than they are by a tenth and leaves white between",
                name="large_dot_m",
            )
        if self.columns == self.rows and not self.is_asymmetric and large is None:
            self._refuse_quarter_turn("circles", ", or mark one by large_dot")
        xy, diameters = step * grid, np.full(len(grid), diameter)
        if large is not None:
            diameters[0] = large
            words += f", the left upper one of {1e3 * large:g} mm"
        self._draw(
            xy,
            box=np.concatenate(
                [(xy - diameters[:, None] / 2).min(axis=0), xy.max(axis=0) + diameter / 2]
            ),
            cell_m=apart,
            # the whole circle, and what is inside or between circles
            clear_m=(diameter, 0.45 * min(diameter, apart - diameter)),
            step_m=(step * (1 + self.is_asymmetric), step),
            words=words,
            discs=np.column_stack([xy, diameters / 2]),
            ambiguous_half_turn=half_turn and large is None,
        )


class AsymmetricCircleGrid(CircleGrid):
    """Rows of black circles, every second one moved to the right by half a step.

    ``spacing_m`` is the distance of the rows, and half of that from centre to centre in a row.
    Neighbours are diagonal.
    """

    name: ClassVar[str] = "asymmetric-circles"
    is_asymmetric: ClassVar[bool] = True


@dataclass(frozen=True, eq=False)
class RoundTarget(Board):
    """A black circle with a white cross in it, and white squares beside three of its corners.

    The corner without a square, right below, tells which way is up. Points are the corners of the
    cross ``(12,)``, then of the squares ``(12,)``, all clockwise. The middle of the circle is none:
    perspective and the lens move the middle of so large an ellipse, and edges that meet in a corner
    they do not.
    """

    name: ClassVar[str] = "round-target"
    diameter_m: float

    def __post_init__(self) -> None:
        super().__post_init__()
        size, (long, half), (near, far) = self.diameter_m, _CROSS, _SQUARE
        bars = [[-long, -half, long, half], [-half, -long, half, long]]
        squares = [[-far, near, -near, far], [-far, -far, -near, -near], [near, -far, far, -near]]
        white = size * np.array(bars + squares)
        arm = size * np.array([[half, -half], [long, -half], [long, half]])
        corners = white[2:, [0, 1, 2, 1, 2, 3, 0, 3]].reshape(-1, 2)
        self._draw(
            np.vstack([*(arm @ turn for turn in QUARTER_TURNS), corners]),
            box=size / 2 * np.array([-1.0, -1.0, 1.0, 1.0]),
            cell_m=2 * half * size,
            # half the end of a bar, and half of what is between a bar and a square
            clear_m=(0.9 * half * size, 0.45 * (near - half) * size),
            step_m=(size, size),
            words=f"round target of {1e3 * size:g} mm with a cross and three squares",
            discs=np.array([[0.0, 0.0, size / 2]]),
            cut_out=white,
        )


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
    inner_corners: Sequence[int] | None = None,
    square_m: float | None = None,
    spacing_m: float | None = None,
    marker_m: float | None = None,
    diameter_m: float | None = None,
    large_dot_m: float | None = None,
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
    inner_corners : sequence of int, optional
        Inner corners of ``charuco`` and ``chessboard`` across and down, in place of columns and
        rows: one less than squares.
    square_m : float, optional
        Side of a square of ``charuco`` and ``chessboard``.
    spacing_m : float, optional
        From marker to marker, or from circle to circle; for ``asymmetric-circles`` from row to row.
    marker_m : float, optional
        Side of the black square of a marker.
    diameter_m : float, optional
        Of circles, where half the distance of neighbours is the default; of a ``round-target``.
    large_dot_m : float, optional
        Diameter of the left upper circle of a grid whose corner is marked by a larger one.
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
    if inner_corners is not None:
        columns, rows = _squares_of(kind, inner_corners, columns, rows)
    given: dict[str, object] = {
        "columns": columns, "rows": rows, "square_m": square_m, "spacing_m": spacing_m,
        "marker_m": marker_m, "diameter_m": diameter_m, "large_dot_m": large_dot_m,
        "dictionary": dictionary, "first_id": first_id, "legacy": legacy or None,
    }  # fmt: skip
    values = {key: value for key, value in given.items() if value is not None}
    board = BOARDS[kind]
    if issubclass(board, MarkerBoard):
        values["dictionary"] = _dictionary_name(kind, dictionary)
    elif issubclass(board, CircleGrid) and diameter_m is None and spacing_m is not None:
        _check_length(spacing_m, "spacing_m")
        near = np.sqrt(2.0) if board is AsymmetricCircleGrid else 1.0
        values["diameter_m"] = float(near * spacing_m / 2)
    known = {own.name: own for own in fields(board) if own.init}
    for key, own in known.items():
        if key not in values and own.default is MISSING:
            raise InputError(f"a {kind} needs {key}", hint="give it", name=key)
    for key in values:
        if key not in known:
            raise InputError(f"a {kind} has no {key}", hint="leave it out", name=key)
    return board(**values)


def _squares_of(
    kind: str, inner_corners: Sequence[int], columns: int | None, rows: int | None
) -> tuple[int, int]:
    """Return columns and rows of squares of a board whose inner corners are counted."""
    if kind not in (CharucoBoard.name, Chessboard.name):
        raise InputError(
            f"a {kind} has no inner_corners", hint="give columns and rows", name="inner_corners"
        )
    if len(inner_corners) != 2:
        raise InputError(
            f"inner_corners of the {kind} are {inner_corners!r}",
            hint="give two numbers, across and down",
            name="inner_corners",
        )
    for value in inner_corners:
        _check_count(value, "inner_corners", kind, least=1, most=MOST_ACROSS - 1)
    squares = int(inner_corners[0]) + 1, int(inner_corners[1]) + 1
    if any(
        given is not None and given != counted
        for given, counted in zip((columns, rows), squares, strict=True)
    ):
        raise InputError(
            f"{inner_corners[0]} x {inner_corners[1]} inner corners are {squares[0]} x "
            f"{squares[1]} squares, columns and rows are {columns} and {rows}",
            hint="give either inner_corners or columns and rows",
            name="inner_corners",
        )
    return squares


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
    said, meant = repr(value), ""
    if number:
        length = float(value)  # type: ignore[arg-type]
        said = f"{1e3 * length:g} mm"
        units = ("metres", 1e3), ("millimetres", 1e-3)
        meant = "".join(
            f"it looks like {unit}: are {1e3 * factor * length:g} mm meant? "
            for unit, factor in units
            if 1e-3 <= factor * length <= 1.0
        )
    raise InputError(
        f"{key} of the board is {said}",
        hint=f"{meant}lengths of boards are from 0.1 mm to 10 m",
        name=key,
    )


def _lattice(columns: int, rows: int) -> FloatArray:
    """Columns and rows ``(rows * columns, 2)``, row by row."""
    row, column = np.divmod(np.arange(rows * columns), columns)
    return np.stack([column, row], axis=1).astype(float)


def _checks(columns: int, rows: int, first: bool) -> FloatArray:
    """Columns and rows ``(M, 2)`` of every second square, the first one or the next."""
    grid = _lattice(columns, rows)
    return np.asarray(grid[(grid.sum(axis=1) % 2 == 0) == first])


def _flat(xy: FloatArray) -> FloatArray:
    return np.column_stack([xy, np.zeros(len(xy))])


def _in_rectangles(xy: FloatArray, rectangles: FloatArray) -> BoolArray:
    x, y = xy.T
    inside = np.zeros(len(xy), dtype=bool)
    for left, top, right, bottom in rectangles:
        inside |= (x >= left) & (x < right) & (y >= top) & (y < bottom)
    return inside
