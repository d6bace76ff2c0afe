"""What all validators have in common; each rule by itself is tested in a file a dialect."""

from __future__ import annotations

import re
from pathlib import Path
from types import ModuleType

import pytest

from posedesign.programs import DIALECTS, robodk_csv, validate
from posedesign.programs.abb_rapid import rules as abb
from posedesign.programs.fanuc_ls import rules as fanuc
from posedesign.programs.kuka_krl import rules as kuka
from posedesign.programs.reading import read_program_bytes
from posedesign.programs.ros import rules as ros
from posedesign.programs.rules import MOST_PROBLEMS
from posedesign.programs.staubli_val3 import rules as staubli
from posedesign.programs.ur_script import rules as ur
from posedesign.programs.yaskawa_jbi import rules as yaskawa
from tests.unit.programs import (
    test_abb_rapid_rules,
    test_fanuc_ls_rules,
    test_kuka_krl_rules,
    test_robodk_csv_read,
    test_ros_rules,
    test_staubli_val3_rules,
    test_ur_script_rules,
    test_yaskawa_jbi_rules,
)
from tests.unit.programs.dialects import dialect_of, program_of

TABLES = {
    abb: test_abb_rapid_rules.ONE_RULE,
    fanuc: test_fanuc_ls_rules.ERRORS + test_fanuc_ls_rules.MEASURING,
    kuka: [*test_kuka_krl_rules.ONE_RULE, ("companion",), ("frame",), ("routine",)],
    staubli: test_staubli_val3_rules.ONE_RULE,
    robodk_csv: [*test_robodk_csv_read.BREAKS, ("beside",)],
    ros: [*test_ros_rules.BREAKS, ("ending",)],
    ur: test_ur_script_rules.ONE_RULE,
    yaskawa: test_yaskawa_jbi_rules.ONE_RULE,
}


@pytest.mark.parametrize("module", TABLES, ids=lambda module: module.__name__.split(".")[-2])
def test_every_rule_of_the_table_is_broken_by_a_file(module: ModuleType) -> None:
    documented = set(re.findall(r"(?m)^``([\w-]+)``", module.__doc__ or ""))
    assert documented == {rule for rule, *_ in TABLES[module]}


RUBBISH = {
    "abb-rapid": "MODULE CAL\n" + "\xe4 nan (;\n" * 5000,
    "fanuc-ls": "".join(f"/{s}  A\n" + "P[1]{ rubbish}\n" * 2000 for s in ("PROG", "MN", "POS")),
    "kuka-krl": "DEF CAL( )\n" + "\xe4 nan (\n" * 5000,
    "moveit-joints": "joint_names: [a, b]\njoint_values:\n" + "- [1e5, 1e5]\n" * 3000,
    "robodk-csv": "x\n" * 5000,
    "staubli-val3": test_staubli_val3_rules.JOINT["Calpose.dtx"].replace(
        "<Datas>", "<Datas>" + '<Data name="" />' * 5000
    ),
    "ur-script": "def x():\n" + "rubbish!\n" * 5000,
    "yaskawa-jbi": "/JOB\n//POS\n" + "rubbish\n" * 5000,
}


@pytest.mark.parametrize("name", RUBBISH)
def test_a_file_of_rubbish_is_not_told_line_by_line(name: str) -> None:
    path = Path(f"/nowhere/CAL{'.src' if name == 'kuka-krl' else DIALECTS[name].suffixes[0]}")
    told = DIALECTS[name].check(RUBBISH[name].encode("latin-1"), path)
    assert len([p for p in told if p.level != "note"]) in range(300, MOST_PROBLEMS + 1)


@pytest.mark.parametrize("name", ["fanuc-ls", "yaskawa-jbi"])
def test_line_ends_are_told_once(name: str) -> None:
    ((file, text),) = DIALECTS[name].files(program_of(name)).items()
    (problem,) = dialect_of(name).check(text.encode(), Path(file))
    said = f"{len(text.splitlines())} lines are not ended by CR LF"
    assert (problem.line, problem.rule, problem.level) == (1, "crlf", "measuring")
    assert problem.message == said


@pytest.mark.parametrize(
    ("name", "old", "new", "rule"),
    [
        ("fanuc-ls", b"% FINE", b"% CNT50", "fine-before-call"),
        ("yaskawa-jbi", b" PL=0", b"", "stop-before-call"),
        ("abb-rapid", b"fine,", b"z10,", "standstill"),
        ("ur-script", b"v=0.3142)", b"v=0.3142, r=0.05)", "stop-to-measure"),
    ],
)
def test_what_does_not_measure_is_told_of_programs_of_plans(name, old, new, rule, tmp_path):
    (path,) = dialect_of(name).write(program_of(name), tmp_path)
    assert old in read_program_bytes(path)
    path.write_bytes(read_program_bytes(path).replace(old, new))
    assert {p.rule for p in validate(path, name)} == {rule}
    path.write_bytes(re.sub(rb"PLAN abcdef12", b"by hand", read_program_bytes(path)))
    assert validate(path, name) == []
    assert {p.rule for p in validate(path, name, levels=["measuring"])} == {rule}
