"""What cannot be chosen from, or for, is refused in one line that says what to do."""

import numpy as np
import pytest

from calib.errors import CalibError, InputError, NotIdentifiableError
from posedesign.selection import (
    criterion_by_name,
    mean_deviation,
    select,
    select_fewest,
)

J = np.random.default_rng(0).normal(size=(12, 2, 3))


def with_(value, at=(5, 0, 1)):
    blocks = J.copy()
    blocks[at] = value
    return blocks


REFUSED = {
    "more poses than candidates": (lambda: select(J, 13), "13 poses of 12 candidates"),
    "no poses": (lambda: select(J, 0), "0 poses"),
    "NaN": (lambda: select(with_(np.nan), 5), "candidate 5 is the first of 1"),
    "infinite": (lambda: select(with_(np.inf), 5), "not finite"),
    "NaN known": (lambda: select(J, 5, known=[[np.nan, 0.0, 0.0]]), "not finite"),
    "no pool": (lambda: select(np.zeros((0, 2, 3)), 1), "blocks (N, m, p)"),
    "a matrix": (lambda: select(J[0], 1), "blocks (N, m, p)"),
    "unknown criterion": (lambda: select(J, 5, "C_H"), "no criterion 'C_H'"),
    "unknown method": (lambda: select(J, 5, method="exchanged"), "no method 'exchanged'"),
    "kept twice": (lambda: select(J, 5, keep=[1, 1]), "different candidates"),
    "kept beyond": (lambda: select(J, 5, keep=[12]), "0 to 11"),
    "more kept than chosen": (lambda: select(J, 2, keep=[1, 2, 3]), "3 of which are kept"),
    "interest beyond": (lambda: select(J, 5, "D", interest=[3]), "columns 0 to 2"),
    "interest of C_G": (lambda: select(J, 5, "C_G", interest=[0]), "of all parameters"),
    "other functions": (lambda: select(J, 5, mean_deviation(np.ones((1, 1, 4)))), "4 parameters"),
    "functions that are zero": (lambda: mean_deviation(np.zeros((1, 1, 3))), "zero"),
    "names": (lambda: select(J, 5, names=["a", "b"]), "2 names for 3 parameters"),
    "threshold": (lambda: select(J, 5, threshold=0.0), "threshold of 0"),
    "fewest of nothing": (lambda: select_fewest(J, "D", np.nan), "nan"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused(case):
    act, words = REFUSED[case]
    with pytest.raises(InputError) as caught:
        act()
    assert words in caught.value.message
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("written", "meant"), [("c_g", "C_G"), ("o5", "O5"), ("COND_2", "cond_2")])
def test_names_in_any_case(written, meant):
    assert criterion_by_name(written, 3, 5).name == meant


def test_near_names_are_offered():
    with pytest.raises(InputError) as caught:
        select(J, 5, "cond2")
    assert "cond_2" in caught.value.hint


def test_what_no_choice_can_identify_is_named():
    hidden = J.copy()
    hidden[..., 2] = 0.0
    with pytest.raises(NotIdentifiableError, match=r"tool\.z") as caught:
        select(hidden, 5, names=["tool.x", "tool.y", "tool.z"])
    assert caught.value.parameters == ("tool.z",)
    merged = J.copy()
    merged[..., 1] = 2.0 * merged[..., 0]
    with pytest.raises(NotIdentifiableError) as both:
        select(merged, 5, names=["a", "b", "c"])
    assert both.value.parameters == ("a", "b")
    # what is known from elsewhere makes up for it
    assert select(hidden, 5, known=[[0.0, 0.0, 1.0]]).status != "not identifiable"


def test_a_threshold_beyond_the_bound_is_refused_at_once():
    found = select(J, 5, "C_G")
    with pytest.raises(InputError) as caught:
        select(J, 5, "C_G", threshold=0.5 * found.bound)
    assert f"no set of 5 poses from this pool can be below {0.5 * found.bound:.4g}" in str(
        caught.value
    )
    assert caught.value.bound == pytest.approx(found.bound)
    assert select(J, 5, "C_G", threshold=2 * found.value).value == found.value
    large = select(J, 5, "D")
    with pytest.raises(InputError, match="can be above"):
        select(J, 5, "D", threshold=1.01 * large.bound)


def test_candidates_that_are_there_twice_are_offered_once():
    doubled = np.concatenate([J, J[:4]])
    found, own = select(doubled, 6, "D"), select(J, 6, "D")
    assert found.duplicates == 4
    assert "4 candidates are there more than once" in found.message
    np.testing.assert_array_equal(found.indices, own.indices)
    with pytest.raises(CalibError, match="13 poses of 12 candidates"):
        select(doubled, 13)


def test_too_few_poses_for_the_parameters_are_said_to_be():
    found = select(J, 1, "D")
    assert found.status == "not identifiable"
    assert "do not determine" in found.message
    assert np.isinf(found.sigma).all()


def test_the_whole_pool_can_be_chosen():
    found = select(J, 12, "D")
    np.testing.assert_array_equal(found.indices, np.arange(12))
    assert found.efficiency == pytest.approx(1.0, abs=1e-6)
    assert found.status == "best"
    all_kept = select(J, 3, "D", keep=[2, 5, 7])
    np.testing.assert_array_equal(all_kept.indices, [2, 5, 7])
