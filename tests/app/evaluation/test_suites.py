"""Suites: those that ship are complete; what is wrong in one gets a sentence that names it."""

from __future__ import annotations

import pytest

from layflat.app.evaluation.suites import cases_of, parse, shipped
from layflat.app.support.errors import UsageError
from layflat.policy.schedule import Trigger
from layflat.sim.disturbances.presets import DISTURBANCES

GOOD = """
schema = 1
about = "Twice while it lands, once when it lies."
[[case]]
name = "landing"
[[case.disturbance]]
like = "push"
scale = [0.5, 1.5]
when = { contact = 0.5 }
repeats = 2
[[case.disturbance]]
kind = "wind"
wind_m_s2 = 2
heading_deg = 90
[[case]]
name = "early"
[[case.disturbance]]
like = "poke"
when = { step = 30 }
"""


def test_a_suite_is_read_into_cases():
    landing, early = parse(GOOD, "mine", "mine.toml")
    assert (landing.name, early.name) == ("mine/landing", "mine/early")
    push, wind = landing.schedule
    assert push.disturbance.scale == (0.5, 1.5)
    assert push.disturbance.path == DISTURBANCES["push"].path
    assert (push.trigger, push.repeats) == (Trigger(kind="contact", value=0.5), 2)
    assert (wind.disturbance.kind, wind.disturbance.heading_deg, wind.trigger) == ("wind", (90.0, 90.0), Trigger())
    assert early.schedule[0].trigger == Trigger(kind="step", value=30)
    assert [case.is_post_stop for case in (landing, early)] == [False, False]


def test_a_single_case_has_the_suites_name():
    text = GOOD[: GOOD.index('[[case]]\nname = "early"')]
    assert [case.name for case in parse(text, "mine", "mine.toml")] == ["mine"]


def test_the_shipped_suites():
    assert shipped() == ("folds", "gentle", "harsh", "thesis", "wind")
    names = [case.name for suite in shipped() for case in cases_of(suite)]
    assert len(names) == len(set(names))
    assert all(case.schedule for suite in shipped() for case in cases_of(suite))


def test_the_thesis_disturbs_twice_after_the_stop():
    (case,) = cases_of("thesis")
    assert case.name == "thesis"
    assert case.is_post_stop
    assert sum(item.repeats for item in case.schedule) == 2


def test_a_single_disturbance_comes_once():
    (case,) = cases_of("poke")
    assert case.schedule[0].disturbance == DISTURBANCES["poke"]
    assert (case.name, case.schedule[0].repeats) == ("poke", 1)


def test_a_file_of_ones_own(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(GOOD)
    assert [case.name for case in cases_of(str(path))] == ["mine/landing", "mine/early"]


def _changed(old: str, new: str) -> str:
    assert old in GOOD
    return GOOD.replace(old, new, 1)


WRONG = {
    "not TOML": ("is not TOML", "schema = = 1"),
    "nested without end": ("is not TOML|schema is", "a = " + "[" * 20_000),
    "no schema": ("schema is None; it must be 1", GOOD.replace("schema = 1", "")),
    "of the future": ("schema is 2; it must be 1", _changed("schema = 1", "schema = 2")),
    "no case": (r"has no \[\[case\]\]", 'schema = 1\nabout = "nothing"'),
    "no disturbance": (r"has no \[\[case.disturbance\]\]", 'schema = 1\n[[case]]\nname = "x"'),
    "a case that is none": (r"has no \[\[case\]\]", "schema = 1\ncase = 3"),
    "unknown key": ("'colour' is unknown there; known are schema, about, case", _changed("about", "colour")),
    "unknown key of a case": ("'note' is unknown there", _changed('name = "early"', 'name = "early"\nnote = 1')),
    "unknown field": ("unknown field 'strength'", _changed("scale = [0.5, 1.5]", "strength = 3")),
    "unknown disturbance": ("unknown disturbance 'soap'", _changed('"push"', '"soap"')),
    "neither kind nor like": ("neither a kind nor", _changed('kind = "wind"', "")),
    "unknown kind": ("kind is 'storm'", _changed('kind = "wind"', 'kind = "storm"')),
    "a range that falls": (r"scale is \(1.5, 0.5\); it must rise", _changed("[0.5, 1.5]", "[1.5, 0.5]")),
    "not a number": ("wind_m_s2 is 'much'", _changed("wind_m_s2 = 2", 'wind_m_s2 = "much"')),
    "not finite": ("wind_m_s2 is inf", _changed("wind_m_s2 = 2", "wind_m_s2 = inf")),
    "no moment": ('when is "later"|when is .later.; it must be', _changed("{ step = 30 }", '"later"')),
    "no step": ("step must be an integer >= 0, got -3", _changed("{ step = 30 }", "{ step = -3 }")),
    "half a step": ("step must be an integer >= 0, got 1.5", _changed("{ step = 30 }", "{ step = 1.5 }")),
    "a truth for a step": ("when is {'step': True}", _changed("{ step = 30 }", "{ step = true }")),
    "contact above 1": ("contact must be within 0..1, got 5", _changed("contact = 0.5", "contact = 5")),
    "never": ("repeats is 0; it must be a whole number from 1", _changed("repeats = 2", "repeats = 0")),
    "too often": ("repeats is 1000", _changed("repeats = 2", "repeats = 1000")),
    "two of a name": ("two cases are named mine/landing", _changed('"early"', '"landing"')),
    "no name": ("case 2 has no name", _changed('name = "early"', "")),
    "a name that is no file's": ("'mine/../up' must be small letters", _changed('"early"', '"../up"')),
    "about nothing": (
        "about is 3; it must be a sentence",
        GOOD.replace('"Twice while it lands, once when it lies."', "3"),
    ),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_is_wrong_is_one_sentence(what):
    words, text = WRONG[what]
    with pytest.raises(UsageError, match=words) as caught:
        parse(text, "mine", "mine.toml")
    assert "\n" not in str(caught.value)
    assert "mine" in str(caught.value)


def test_names_and_files_that_are_none(tmp_path):
    with pytest.raises(UsageError, match=r"disturbance 'soap' is unknown; give one of folds, .*thesis.*FILE\.toml"):
        cases_of("soap")
    with pytest.raises(UsageError, match="'none' is unknown"):
        cases_of("none")
    with pytest.raises(UsageError, match="No such file"):
        cases_of(str(tmp_path / "missing.toml"))
    (tmp_path / "folder.toml").mkdir()
    with pytest.raises(UsageError, match="Is a directory"):
        cases_of(str(tmp_path / "folder.toml"))
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(UsageError, match="save it as UTF-8"):
        cases_of(str(tmp_path / "bytes.toml"))
    (tmp_path / "large.toml").write_text("# " + "x" * 200_000)
    with pytest.raises(UsageError, match="has at most 100000"):
        cases_of(str(tmp_path / "large.toml"))


ACCENTED = GOOD.replace("Twice", "D\u00e9j\u00e0: twice")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
def test_a_suite_of_any_editor(tmp_path, encoding):
    path = tmp_path / "mine.toml"
    path.write_bytes(ACCENTED.replace("\n", "\r\n").encode(encoding))
    assert cases_of(str(path))[0].name == "mine/landing"


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "latin-1"])
def test_another_encoding_is_named_with_the_right_one(tmp_path, encoding):
    path = tmp_path / "mine.toml"
    path.write_bytes(ACCENTED.encode(encoding))
    with pytest.raises(UsageError, match=r"mine\.toml is not UTF-8 text; save it as UTF-8"):
        cases_of(str(path))
