"""Expressions of xacro files: worked out as Python would, without what Python could do."""

import math
import operator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.robots.description.xacro_process import LONGEST_EXPRESSION, ExpressionError, evaluate

SYMBOLS = {
    "a": 2.5,
    "n": 3,
    "prefix": "left_",
    "flag": True,
    "table": {"limits": {"j1": [1.0, 2.0]}, "mass": 4},
    "math": {"pi": math.pi, "sin": math.sin},
    "xyz": [1, 2, 3],
    "function": len,
}

UNDERSTOOD = {
    "1 + 2*a - n/2 // 1": 1 + 2 * 2.5 - 3 / 2 // 1,
    "-a**2 % 2": -(2.5**2) % 2,
    "radians(180) - math.pi": 0.0,
    "math.sin(math.pi / 2)": 1.0,
    "prefix + 'link'": "left_link",
    "'%s%d' % (prefix, n)": "left_3",
    "not flag or n > 2 and a <= 2.5": True,
    "0 or '' or n": 3,
    "1 < n < 3": False,
    "1 if prefix == '' else 2": 2,
    "table.limits.j1[1]": 2.0,
    "table['limits']['j1'][-1]": 2.0,
    "table.mass": 4,
    "'j1' in table.limits and 'j2' not in table.limits": True,
    "xyz[1:]": [2, 3],
    "[x * y for x, y in zip(xyz, [1, 1, 2]) if x != 2]": [1, 6],
    "sum(x for x in xyz)": 6,
    "' '.join([str(x) for x in xyz])": "1 2 3",
    "prefix.startswith('left') and prefix.upper()": "LEFT_",
    "table.limits.keys()": ["j1"],
    "table.get('none', 7)": 7,
    "max(xyz) + min(1, n) + abs(-1) + len(xyz)": 8,
    "round(a * 3, ndigits=1)": 7.5,
    "python.abs(-2)": 2,
    "None is None": True,
    "(1, 2)": (1, 2),
    "  n ": 3,
}


@pytest.mark.parametrize("text", UNDERSTOOD)
def test_understood(text):
    assert evaluate(text, SYMBOLS) == UNDERSTOOD[text]


REFUSED = {
    "().__class__": "two underscores",
    "('{0._' + '_class_' + '_}').format(n)": "format. is not a function known here",
    "(x for x in xyz).gi_frame": "is not defined",
    "[g.gi_frame for g in [(x for x in xyz)]]": "'g.gi_frame' is not defined",
    "(lambda: 1)()": "not a function known here",
    "lambda: 1": "is not understood here",
    "{1: 2}": "is not understood here",
    "f'{n}'": "is not understood here",
    "(m := 1)": "is not understood here",
    "[*xyz]": "is not understood here",
    "b'x'": "is not understood here",
    "n @ n": "operator MatMult",
    "open('x')": "'open' is not a function known here",
    "eval('1')": "'eval' is not a function known here",
    "getattr(n, 'real')": "'getattr' is not a function known here",
    "type(n)": "'type' is not a function known here",
    "math.nothing(1)": "'math.nothing' is not a function known here",
    "function(xyz)": "'function' is not a function known here",
    "function": "'function' is not a value",
    "math.sin": "'math.sin' is not a value",
    "len": "name 'len' is not defined",
    "n.real": "'n.real' is not defined",
    "table.none": "'table.none' is not defined",
    "nothing": "name 'nothing' is not defined",
    "xyz.append(4)": "'xyz.append' is not a function known here",
    "[x for xyz[0] in xyz]": "is not understood here",
    "1 +": "not an expression",
    "import os": "not an expression",
    "1; 2": "not an expression",
    "x" * (LONGEST_EXPRESSION + 1): "more than 2000 characters",
}


@pytest.mark.parametrize("text", REFUSED)
def test_refused(text):
    with pytest.raises(ExpressionError, match=REFUSED[text]):
        evaluate(text, SYMBOLS)


def test_a_loop_variable_does_not_outlive_its_loop():
    assert evaluate("[[x for x in [9]], x]", {"x": 1}) == [[9], 1]


VALUES = {"a": 2.5, "n": 3, "pi": math.pi}
NUMBERS = st.integers(0, 50).map(lambda i: (str(i), i)) | st.sampled_from(sorted(VALUES.items()))
OPERATORS = {"+": operator.add, "-": operator.sub, "*": operator.mul}


def joined(parts):
    (left, x), sign, (right, y) = parts
    return f"({left} {sign} {right})", OPERATORS[sign](x, y)


@given(
    st.recursive(
        NUMBERS,
        lambda inner: st.tuples(inner, st.sampled_from("+-*"), inner).map(joined),
        max_leaves=8,
    )
)
def test_arithmetic_is_pythons(case):
    text, value = case
    assert evaluate(text, VALUES) == value
