"""Answers at a glance: what is dropped first, and what never is."""

from __future__ import annotations

import pytest

from posedesign.report.answer import MOST_LINES, WIDTH, Answer, Line


def height(lines: list[Line]) -> int:
    return sum(line.height for line in lines)


def test_a_short_answer_is_told_whole():
    answer = Answer(
        "done", {"tool point": "0.1 mm"}, ["odd"], ["the view"], files=["a"], then="posedesign x"
    )
    assert [line.wrapped() for line in answer.short("more")] == [
        ["done"],
        ["tool point: 0.1 mm"],
        ["warning: odd"],
        ["not checked: the view"],
        ["wrote: a"],
        ["next: posedesign x"],
    ]


@pytest.mark.parametrize("words", [1, 40, 90])
def test_a_long_one_keeps_what_matters_most_and_says_how_much_is_left(words):
    many = [f"{k} " + "word " * words for k in range(9)]
    answer = Answer(
        "verdict", dict.fromkeys("abcdefgh", "figure"), many, many, many, files=["f"], then="n"
    )
    short = answer.short("see more")
    assert height(short) <= MOST_LINES
    assert (short[0].text, short[-2].text, short[-1].text) == ("verdict", "f", "n")
    kept = sum(line.what not in ("", "wrote", "next") for line in short) - 1
    cut = sum(line.text.endswith(" ...") for line in short)
    assert short[-3] == Line("more", f"{8 + 27 - kept + cut} more to know: see more")
    assert [line.what for line in short if line.what == "a"] == ["a"]
    for what in ("warning", "not checked"):
        told = [line.text for line in short if line.what == what]
        assert told[0].split()[:20] == many[0].split()[:20]
        assert told[0].endswith(" ...") == (words == 90)


def test_a_second_warning_comes_before_a_second_figure():
    answer = Answer(
        "v " * 90,
        {"a": "x " * 60, "b": "y " * 60, "c": "z " * 60},
        ["one " * 20, "SECOND"],
        ["the view", "the tool"],
        files=["f " * 40],
        then="n",
    )
    told = [line.text for line in answer.short("more")]
    assert {"SECOND", "the view", "the tool"} <= set(told)


def test_long_names_of_files_push_no_warning_out():
    names = [f"{'folder/' * 12}file_{k}.csv" for k in range(9)]
    answer = Answer("v", {"a": "x " * 60}, ["FIRST"], ["the view"], files=names, then="go " * 60)
    short = answer.short("more")
    assert height(short) <= MOST_LINES
    assert {"FIRST", "the view"} <= {line.text for line in short}
    assert [line.is_cut for line in short if line.what == "wrote"] == [True]
    assert short[-1].text == "go " * 60


def test_what_is_cut_is_counted():
    answer = Answer("done", {}, ["missing " * 80])
    short = answer.short("see more")
    assert short[1].text.endswith("missing ...")
    assert short[-1] == Line("more", "1 more to know: see more")


def test_lines_fit_the_width_and_words_are_whole():
    path = "/a/" + "long/" * 40 + "poses.csv"
    lines = Line("wrote", f"{path}, " + "other words " * 20).wrapped()
    assert path + "," in " ".join(lines).split()
    assert max(len(line) for line in lines if path not in line) <= WIDTH


def test_what_was_not_checked_stays_with_the_result():
    assert Line("not checked", "x").goes_with_result
    assert Line("not checked", "x").is_remark
    assert not Line("warning", "x").goes_with_result
    assert Line("tool point", "x").goes_with_result
    assert not Line("tool point", "x").is_remark
