"""A statement has one tree, whatever was parsed before it: equal forms share what built it."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

from posedesign.programs.abb_rapid.module import LANGUAGE as RAPID
from posedesign.programs.denso_pac import LANGUAGE as PAC
from posedesign.programs.fanuc_ls.listing import LANGUAGE as TP
from posedesign.programs.kawasaki_as import LANGUAGE as AS
from posedesign.programs.kuka_krl.syntax import LANGUAGE as KRL
from posedesign.programs.language import Language
from posedesign.programs.mitsubishi_melfa import LANGUAGE as MELFA
from posedesign.programs.staubli_val3.project import LANGUAGE as VAL3
from posedesign.programs.ur_script.reader import LANGUAGE as UR
from posedesign.programs.yaskawa_jbi.reader import INFORM
from tests.unit.programs.dialects import CASES
from tests.unit.programs.test_all_dialects import written

LANGUAGES = {
    "abb-rapid": RAPID,
    "denso-pac": PAC,
    "fanuc-ls": TP,
    "kawasaki-as": AS,
    "kuka-krl": KRL,
    "mitsubishi-melfa": MELFA,
    "staubli-val3": VAL3,
    "ur-script": UR,
    "yaskawa-jbi": INFORM,
}


def fresh(language: Language) -> Language:
    """The same language and parser without what it remembers."""
    forgetful = replace(language, _shapes={}, _kept={}, _last={})
    forgetful.parser = language.parser
    return forgetful


def test_a_position_0_is_not_taken_for_later_ones() -> None:
    language = fresh(MELFA)
    trees = [s.tree for s in language.statements("1 Mov J0\n2 Mov J10\n3 Mov J11\n")]
    assert [[str(t) for t in tree.scan_values(lambda _: True)] for tree in trees] == [
        ["1", "J0"],
        ["2", "J10"],
        ["3", "J11"],
    ]


@pytest.mark.parametrize(
    ("name", "form"),
    [
        pytest.param(name, form, marks=[pytest.mark.slow] * (form == "cartesian"))
        for name, form in CASES
        if name in LANGUAGES
    ],
)
def test_what_was_read_before_changes_no_tree(name: str, form: str) -> None:
    text = written(name, form)[1]
    language = fresh(LANGUAGES[name])
    variants = [re.sub(r"\d+", digit, text) for digit in ("0", "10", "\0")]
    cold = [[s.tree for s in fresh(language).statements(t)] for t in [text, *variants]]
    for some in (variants, variants[::-1]):
        warm = fresh(language)
        for each in some:
            warm.statements(each)
        assert [[s.tree for s in warm.statements(t)] for t in [text, *variants]] == cold


def test_a_sign_behind_several_blanks_is_of_its_own_number() -> None:
    language = fresh(UR)
    trees = [s.tree for s in language.statements("q = [  -1.0, 2]\nq = [  -5.0, 3]\nq = [7, 4]\n")]
    assert ["".join(tree.scan_values(lambda _: True)) for tree in trees] == [
        "q[-1.0,2]",
        "q[-5.0,3]",
        "q[7,4]",
    ]
