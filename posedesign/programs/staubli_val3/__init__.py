"""Staubli VAL 3 projects: writer, reader and validator."""

from __future__ import annotations

from posedesign.programs.dialect import Dialect
from posedesign.programs.notation import MOVING_XYZ, Notation
from posedesign.programs.staubli_val3.reader import attributes_of, parse_staubli_val3
from posedesign.programs.staubli_val3.rules import check_staubli_val3
from posedesign.programs.staubli_val3.writer import NAMES, render_staubli_val3

__all__ = ["StaubliVal3"]


class StaubliVal3(Dialect):
    """Staubli VAL 3 projects: a folder with data, programs and the project file."""

    name = "staubli-val3"
    title = "Staubli VAL 3 project"
    maker = "staubli"
    suffixes = (".dtx", ".pjx", ".pgx")
    remark = (r"\A(?:<\?xml[^\n]*\n)?", "<!-- {words} -->")
    companions = (".pjx", ".pgx")
    in_folder = True
    names = NAMES
    encoding = "utf-8"
    notation = Notation(joint=5, place=4, turned=5, turn=MOVING_XYZ, literals=attributes_of)
    writer = render_staubli_val3
    reader = parse_staubli_val3
    rules = check_staubli_val3
