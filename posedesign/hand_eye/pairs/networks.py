"""Pairs of several cameras, targets and arms: where they come from, and what is found, as rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.errors import FileFormatError, InputError
from calib.robot_world import FramePrior, NetworkResult, Noise, solve_network
from calib.se3 import wpr_from_rotation
from posedesign.hand_eye.pairs.certificate import Camera
from posedesign.hand_eye.pairs.file import Pairs, expanded, read_numbers
from posedesign.hand_eye.pairs.source import PairSource

ON_FLANGE, AROUND, ARM = "on_flange", "around", "arm"
"""Columns of a table, and names of an edge: what is on the flange, what stands around, the arm."""

_ONE_ARM = "arm"


@dataclass(frozen=True)
class EdgeFile:
    """Files of the pairs of one edge: of one thing on the flange and one around."""

    names: tuple[str, str, str]  # on the flange, around, the arm
    files: tuple[Path, ...]  # one with both sides, or that of A and that of B

    @classmethod
    def of(cls, text: str) -> EdgeFile:
        """Read ``camera,target[,arm]=PAIRS`` or ``camera,target[,arm]=A,B``.

        Raises
        ------
        InputError
            Another form.
        """
        left, _, right = text.partition("=")
        names = [name.strip() for name in left.split(",")]
        files = [name.strip() for name in right.split(",")]
        if (
            len(names) not in (2, 3)
            or len(files) not in (1, 2)
            or not all((*names, *files))
            or not all(map(str.isprintable, names))
        ):
            raise InputError(
                f"`edge` {text!r} is not a name on the flange, a name around, and files",
                hint="say camera_1,tag_7=pairs.csv, or camera_1,tag_7,arm_2=A.csv,B.csv",
                name="edge",
                value=text,
            )
        return cls((names[0], names[1], (*names, _ONE_ARM)[2]), tuple(map(Path, files)))

    def read(self, how: PairSource) -> Pairs:
        """Read the pairs as ``how`` understands files."""
        a, b = self.files if len(self.files) == 2 else (None, None)
        one = self.files[0] if b is None else None
        return replace(how, pairs=one, a=a, b=b).read()


@dataclass(frozen=True, eq=False)
class NetworkPairs:
    """Pairs, and between which frames each is."""

    pairs: Pairs
    on_flange: tuple[str, ...]
    around: tuple[str, ...]
    arms: tuple[str, ...]

    @classmethod
    def of_one(cls, pairs: Pairs, camera: Camera) -> NetworkPairs:
        """Return pairs of one camera and one target, by the place of the camera."""
        on_flange, around = ("camera", "target")[:: 1 if camera == "on-flange" else -1]
        count = len(pairs.A)
        return cls(pairs, (on_flange,) * count, (around,) * count, (_ONE_ARM,) * count)

    def solved(
        self, noise: Noise | None, priors: Sequence[FramePrior] = (), *, in_part: bool = False
    ) -> NetworkResult:
        """Solve them; see :func:`calib.robot_world.solve_network`."""
        return solve_network(
            self.pairs.A,
            self.pairs.B,
            self.on_flange,
            self.around,
            self.arms,
            noise=noise,
            priors=priors,
            in_part=in_part,
        )


def read_table_of_network(path: Path, how: PairSource) -> NetworkPairs:
    """Read a table of pairs with the columns on_flange, around and, of several arms, arm.

    Raises
    ------
    FileFormatError
        A column or a name is missing.
    """
    table = read_numbers(path, expanded(how.columns))
    for column in (ON_FLANGE, AROUND):
        if column not in table.columns:
            raise FileFormatError(
                f"has no column {column}",
                path=path,
                row=1,
                hint=f"{ON_FLANGE} names what is on the flange in each pair, {AROUND} what stands "
                "around; or give files of one camera and one target each with `edge`; where there "
                "is one of each, take robot-world",
            )
    pairs = replace(how, pairs=path).read(of_two_frames=False)
    numbers = pairs.numbers or tuple(range(len(pairs.A)))
    named: list[tuple[str, ...]] = []
    for column in (ON_FLANGE, AROUND, ARM):
        cells = [table.rows[i].cells.get(column, "").strip() for i in numbers]
        if column == ARM and column not in table.columns:
            cells = [_ONE_ARM] * len(cells)
        for i, cell in zip(numbers, cells, strict=True):
            if not cell:
                raise FileFormatError(
                    "the name is missing", path=path, row=table.rows[i].line, column=column
                )
        named.append(tuple(cells))
    return NetworkPairs(pairs, *named)


def read_edges(edges: Sequence[str], how: PairSource) -> NetworkPairs:
    """Read files of one edge each; see :meth:`EdgeFile.of`."""
    both = [(file, file.read(how)) for file in map(EdgeFile.of, edges)]
    names = [
        tuple(file.names[k] for file, pairs in both for _ in range(len(pairs.A))) for k in range(3)
    ]
    notes: list[str] = []
    for _, pairs in both:
        notes += [*pairs.notes, *([pairs.misread] if pairs.misread else [])]
    whole = Pairs(
        tuple(
            f"{file.names[0]}, {file.names[1]}: {name}"
            for file, pairs in both
            for name in pairs.names
        ),
        np.concatenate([pairs.A for _, pairs in both]),
        np.concatenate([pairs.B for _, pairs in both]),
        notes=tuple(dict.fromkeys(notes)),
    )
    return NetworkPairs(whole, *names)


def frame_rows(result: NetworkResult) -> list[dict[str, object]]:
    """Return one row a frame: its place and turn in its parent, and how certain they are."""
    rows = []
    for row, T in zip(result.rows(), result.T, strict=True):
        wpr = np.degrees(wpr_from_rotation(T[:3, :3]))
        turns = dict(zip(("w_deg", "p_deg", "r_deg"), wpr.tolist(), strict=True))
        sigma = {key: row[key] for key in ("sigma_mm", "sigma_deg")}
        place = {key: value for key, value in row.items() if key not in sigma}
        rows.append({**place, **turns, **sigma})
    return rows


def edge_rows(result: NetworkResult) -> list[dict[str, object]]:
    """Return one row an edge: its pairs, what they leave over, and the noise taken for it."""
    net, rows = result.network, []
    for edge in range(net.edges.max() + 1):
        own = net.edges == edge
        used = own & result.used
        left = result.residuals[used]
        i = int(np.flatnonzero(own)[0])
        rows.append(
            {
                ON_FLANGE: net.on_flange[net.k[i]],
                AROUND: net.around[net.l[i]],
                ARM: net.arms[net.j[i]],
                "pairs": int(own.sum()),
                "used": int(used.sum()),
                "residual_mm": 1e3 * _rms(left[:, 3:]),
                "residual_deg": float(np.degrees(_rms(left[:, :3]))),
                "noise_mm": 1e3 * float(result.sigma[edge, 1]),
                "noise_deg": float(np.degrees(result.sigma[edge, 0])),
            }
        )
    return rows


def pair_rows_of_network(found: NetworkPairs, result: NetworkResult) -> list[dict[str, object]]:
    """Return one row a pair: its frames, whether it is used, and what it leaves over."""
    return [
        {
            "pose": name,
            ON_FLANGE: on_flange,
            AROUND: around,
            ARM: arm,
            "used": "yes" if used else "no",
            "residual_mm": 1e3 * float(np.linalg.norm(left[3:])),
            "residual_deg": float(np.degrees(np.linalg.norm(left[:3]))),
        }
        for name, on_flange, around, arm, used, left in zip(
            found.pairs.names,
            found.on_flange,
            found.around,
            found.arms,
            result.used,
            result.residuals,
            strict=True,
        )
    ]


def network_as_dict(result: NetworkResult) -> Mapping[str, object]:
    """Return frames, edges, findings and the joint covariance, for JSON."""
    return {
        "frames": frame_rows(result),
        "T": {name: T.tolist() for name, T in zip(result.names, result.T, strict=True)},
        "covariance": result.covariance.tolist(),
        "covariance_of": [
            f"{name}.{axis}"
            for name in result.names
            for axis in ("rx_rad", "ry_rad", "rz_rad", "x_m", "y_m", "z_m")
        ],
        "edges": edge_rows(result),
        "not_told": list(result.not_told),
        "findings": [{"text": one.text, "grade": one.grade} for one in result.findings],
        "ok": result.is_ok,
    }


def _rms(rows: np.ndarray) -> float:
    return float(np.sqrt((rows**2).sum(axis=1).mean())) if len(rows) else float("nan")
