"""Edit log: what edits make of a session, in everything that reads it; undo; durability; bad input."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from layflat.data import (
    DataError,
    SessionEditor,
    SessionRecorder,
    filter_session,
    merge,
    open_session,
    read_log,
    repair,
    trim,
    validate,
)
from layflat.data.format import schema
from layflat.data.session.edit_log import header, line_of, log_path, new_edit
from tests.factories import differences, make_episode, without_ground_truth, write_session


@pytest.fixture
def path(tmp_path):
    return write_session(tmp_path / "s.h5", [make_episode(n_steps=6 + k, seed=k, images=k == 1) for k in range(4)])


@pytest.fixture
def editor(path):
    return SessionEditor(path, who="ann@lab")


def same_sessions(a, b):
    """Assert that everything that is read of two sessions is the same, but for the uids."""
    assert a.names == b.names
    for name in a.names:
        assert differences(a.episode(name), b.episode(name)) == []
        assert replace(a.info(name), uid="") == replace(b.info(name), uid="")
        one, two = a.rows(name, images=True), b.rows(name, images=True)
        assert one.keys() == two.keys()
        assert all(np.array_equal(one[key], two[key], equal_nan=one[key].dtype.kind == "f") for key in one)
        for key in schema.FIELDS:
            if b.row_shape(name, key) is not None:
                found, wanted = a.array(name, key), b.array(name, key)
                assert (found.dtype, found.tobytes()) == (wanted.dtype, wanted.tobytes()), key
                assert a.array(name, key, slice(1, 3)).tobytes() == wanted[1:3].tobytes()
    assert a.contents() == b.contents()


def test_edits_change_what_is_read_and_not_the_recording(path, editor):
    recorded = path.read_bytes()
    with open_session(path) as session:
        before = session.infos()
    editor.relabel("demo_0", "failure")
    editor.drop("demo_2")
    editor.note("demo_3", "the hem  \u00fc is folded")
    with open_session(path) as session:
        assert session.names == ("demo_0", "demo_1", "demo_3")
        assert len(session) == 3
        assert "demo_2" not in session
        assert session.info("demo_0") == replace(before["demo_0"], outcome="failure")
        assert session["demo_0"].outcome == "failure"
        assert session.attributes("demo_0")[schema.SUCCESS] is False
        assert session.info("demo_3").note == "the hem  \u00fc is folded"
        assert session.select(outcome="success") == ("demo_1", "demo_3")
        assert len(session.arrays(["action_m"])["action_m"]) == 6 + 7 + 9
        assert session.dropped["demo_2"].who == "ann@lab"
        for read in (session.info, session.episode, lambda name: session.array(name, "action_m")):
            with pytest.raises(DataError, match=r"has demo_2 no more: ann@lab dropped it on .* restore demo_2"):
                read("demo_2")
    with open_session(path, edits=False) as session:
        assert session.infos() == before
    editor.restore("demo_2")
    editor.note("demo_3", "")
    editor.relabel("demo_0", "success")
    with open_session(path) as session:
        assert session.infos() == before
    assert path.read_bytes() == recorded
    assert [p.name for p in sorted(path.parent.iterdir())] == ["s.h5", "s.h5.edits.jsonl"]


@pytest.mark.parametrize("name", ["demo_0", "demo_1"])
@pytest.mark.parametrize(("start", "stop"), [(0, 3), (2, 6), (1, 2), (0, 6)])
def test_a_trimmed_episode_reads_as_one_that_was_written_so(path, tmp_path, editor, name, start, stop):
    whole = name == "demo_0" and (start, stop) == (0, 6)
    trim(path, tmp_path / "t.h5", name=name, start=start, stop=stop)
    editor.trim(name, start, stop)
    editor.note(name, "")
    with open_session(path) as session, open_session(tmp_path / "t.h5") as written:
        same_sessions(session, written)
        assert whole or session.info(name).uid == written.info(name).uid
    filter_session(path, tmp_path / "f.h5")
    assert validate(tmp_path / "f.h5") == ()
    with open_session(path) as session, open_session(tmp_path / "f.h5") as written:
        same_sessions(session, written)
        assert session.infos() == written.infos()
    editor.trim(name, 0, 6)
    editor.undo()
    editor.undo()
    editor.undo()
    with open_session(path) as session, open_session(path, edits=False) as raw:
        same_sessions(session, raw)


def test_a_trim_without_ground_truth(tmp_path):
    path = write_session(tmp_path / "s.h5", [without_ground_truth(make_episode(n_steps=6))])
    SessionEditor(path).trim("demo_0", 1, 4)
    trim(path, tmp_path / "t.h5", name="demo_0", start=0, stop=3)
    with open_session(path) as session, open_session(tmp_path / "t.h5") as written:
        same_sessions(session, written)
        assert session.info("demo_0").first_step == 1


def test_a_label_stays_where_only_rest_is_cut_off(tmp_path):
    made = make_episode(n_steps=6)
    last = made.steps[4].observation
    truth = made.steps[4].ground_truth
    lying = replace(
        made,
        steps=(*made.steps[:5], replace(made.steps[5], observation=last, ground_truth=truth)),
        final_observation=replace(last, contact_portion=last.contact_portion + 0.009),
        final_ground_truth=truth,
    )
    path = write_session(tmp_path / "s.h5", [lying])
    editor = SessionEditor(path)
    for stop, outcome, stopped_by in (
        (5, "success", "converged"),
        (4, "success", "converged"),
        (3, "partial", "interrupted"),
    ):
        editor.trim("demo_0", 0, stop)
        with open_session(path) as session:
            assert (session[0].outcome, session.info("demo_0").stopped_by) == (outcome, stopped_by)
    editor.relabel("demo_0", "failure")
    with open_session(path) as session:
        assert session.info("demo_0").outcome == "failure"


def test_merge_and_repair_and_renumbering_keep_edits(path, tmp_path, editor):
    other = write_session(tmp_path / "o.h5", [make_episode(n_steps=5, seed=9)])
    editor.drop("demo_0")
    editor.relabel("demo_1", "failure")
    editor.note("demo_3", "good")
    merge([other, path], tmp_path / "m.h5")
    with open_session(tmp_path / "m.h5") as merged:
        assert [(info.seed, info.outcome, info.note) for info in merged.infos().values()] == [
            (9, "success", ""),
            (1, "failure", ""),
            (2, "success", ""),
            (3, "success", "good"),
        ]
    assert validate(tmp_path / "m.h5") == ()
    # The same log beside a session in which the episodes have other numbers.
    merged = tmp_path / "r.h5"
    raw = tmp_path / "raw.h5"
    raw.write_bytes(path.read_bytes())
    merge([other, raw], merged)
    log_path(merged).write_bytes(log_path(path).read_bytes())
    repair(merged)
    with open_session(merged) as session:
        assert {name: info.seed for name, info in session.infos().items()} == {
            "demo_0": 9,
            "demo_2": 1,
            "demo_3": 2,
            "demo_4": 3,
        }
        assert session.info("demo_2").outcome == "failure"
    # Other identities, as after an import: known by content.
    rerecorded = write_session(
        tmp_path / "i.h5", [make_episode(n_steps=6 + k, seed=k, images=k == 1) for k in (3, 1, 0)]
    )
    log_path(rerecorded).write_bytes(log_path(path).read_bytes())
    with open_session(rerecorded) as session:
        assert [(info.seed, info.outcome, info.note) for info in session.infos().values()] == [
            (3, "success", "good"),
            (1, "failure", ""),
        ]


def test_undo_and_redo_any_edit(path, editor):
    def labels():
        with open_session(path) as session:
            return {name: info.outcome[0] for name, info in session.infos().items()}

    start = labels()
    editor.relabel("demo_0", "failure")
    editor.drop("demo_1")
    editor.relabel("demo_0", "partial")
    assert labels() == {"demo_0": "p", "demo_2": "s", "demo_3": "s"}
    assert editor.undo(2).value == 2
    assert labels() == start | {"demo_0": "p"}
    assert editor.undo().value == 3
    assert labels() == start | {"demo_0": "f"}
    editor.undo(4)  # Redo of the drop.
    assert labels() == {"demo_0": "f", "demo_2": "s", "demo_3": "s"}
    assert [editor.undo().value, editor.undo().value] == [2, 1]
    assert labels() == start
    with pytest.raises(DataError, match="has no edit to undo"):
        editor.undo()
    with pytest.raises(DataError, match=r"edit 3 of .* has been undone already .relabel demo_0 partial"):
        editor.undo(3)
    with pytest.raises(DataError, match="has no edit 99; it has 8"):
        editor.undo(99)
    assert [edit.number for edit in editor.log().edits] == list(range(1, 9))


@pytest.mark.parametrize(
    ("edit", "sentence"),
    [
        (lambda e: e.relabel("demo_0", "good"), "outcome is 'good'; it must be one of success, failure, partial"),
        (lambda e: e.drop("demo_9"), "has no episode 'demo_9'; it has 4 from demo_0 to demo_3"),
        (lambda e: e.trim("demo_0", 2, 2), "steps 2 to 2 of demo_0 cannot be kept; it has the steps 0 to 6"),
        (lambda e: e.trim("demo_0", 0, 7), "cannot be kept"),
        (lambda e: e.restore("demo_0"), "was not dropped"),
        (lambda e: e.note("demo_0", "x" * 2001), "at most 2000"),
    ],
)
def test_wrong_edits_change_nothing(path, editor, edit, sentence):
    with pytest.raises(DataError, match=sentence):
        edit(editor)
    assert not log_path(path).exists()
    assert [p.name for p in path.parent.iterdir()] == ["s.h5"]


def test_dropped_twice_and_no_session(path, editor, tmp_path):
    editor.drop("demo_0")
    with pytest.raises(DataError, match="is dropped already"):
        editor.drop("demo_0")
    with pytest.raises(DataError, match=r"x\.h5 does not exist"):
        SessionEditor(tmp_path / "x.h5").undo()
    assert not (tmp_path / "x.h5.parts").exists()


def test_a_torn_last_line_is_ignored_with_a_sentence(path, editor, caplog):
    editor.drop("demo_0")
    editor.drop("demo_1")
    log = log_path(path)
    whole = log.read_bytes()
    first = whole.rindex(b"\n", 0, -1) + 1
    for end in range(first + 1, len(whole)):
        log.write_bytes(whole[:end])
        assert "the last line is incomplete" in read_log(path).torn
    log.write_bytes(whole[: first + 20] + b"\0" * 50 + b"\n")
    caplog.clear()
    with open_session(path) as session:
        assert session.names == ("demo_1", "demo_2", "demo_3")
    assert "the last line is incomplete" in caplog.text
    editor.drop("demo_3")
    assert [edit.episode for edit in read_log(path).edits] == ["demo_0", "demo_3"]
    assert read_log(path).torn == ""


def test_any_wrong_byte_of_a_log_is_refused(path, editor):
    editor.relabel("demo_0", "failure")
    editor.trim("demo_1", 1, 3)
    editor.note("demo_2", "n")
    log = log_path(path)
    whole = log.read_bytes()
    rng = np.random.default_rng(0)
    for place in rng.choice(len(whole) - 1, 60, replace=False):
        log.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
        with pytest.raises(
            DataError, match=r"s\.h5\.edits\.jsonl is (not an edit log|damaged in line|an edit log of version)"
        ):
            open_session(path)
    lines = whole.splitlines(keepends=True)
    for wrong in (
        lines[:1] + lines[2:],
        lines[:2] + lines[3:],
        [lines[0], lines[2], lines[1], lines[3]],
        [b"hello\n"],
        [b""],
        [b"{}\n"],
    ):
        log.write_bytes(b"".join(wrong))
        with pytest.raises(
            DataError, match=r"edits\.jsonl is (not an edit log of layflat; move it away|damaged in line \d)"
        ):
            open_session(path)
        with pytest.raises(DataError):
            editor.undo()
    open_session(path, edits=False).close()
    log.write_bytes(whole)
    open_session(path).close()


@pytest.mark.parametrize(
    "values",
    [
        {"kind": "relabel", "value": "good"},
        {"kind": "undo", "value": 1},
        {"kind": "trim", "value": [3, 1]},
        {"kind": "x"},
    ],
)
def test_lines_that_make_no_sense_are_refused(path, values):
    first, check = header()
    edit = replace(new_edit(read_log(path), "drop", who="x", episode="demo_0"), **values)
    log_path(path).write_bytes(first + line_of(edit, check)[0])
    with pytest.raises(DataError, match=r"damaged in line 2 .it is no edit"):
        open_session(path)


def test_a_later_version_is_refused(path):
    log_path(path).write_text(json.dumps({"schema": "layflat-edits", "version": 2}) + "\n")
    with pytest.raises(DataError, match="is an edit log of version 2; this layflat reads version 1"):
        open_session(path)


WRITER = """
import sys
from layflat.data import SessionEditor
editor = SessionEditor(sys.argv[1], who=sys.argv[2])
for k in range(20):
    editor.note("demo_0", f"{sys.argv[2]} {k}")
"""


def test_writers_do_not_lose_each_others_edits(path):
    writers = [subprocess.Popen([sys.executable, "-c", WRITER, str(path), who]) for who in ("ann", "bob")]
    assert [writer.wait(60) for writer in writers] == [0, 0]
    edits = read_log(path).edits
    assert sorted(edit.value for edit in edits) == sorted(f"{who} {k}" for who in ("ann", "bob") for k in range(20))


def test_a_read_only_folder_is_read():
    folder = Path(tempfile.mkdtemp())
    try:
        path = write_session(folder / "s.h5", [make_episode(seed=k) for k in range(2)])
        editor = SessionEditor(path)
        editor.drop("demo_0")
        folder.chmod(0o555)
        child = os.fork()
        if child == 0:
            os._exit(read_without_writing(path, editor))
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    finally:
        folder.chmod(0o755)
        shutil.rmtree(folder)


def read_without_writing(path, editor):
    """Return 0 where a session whose folder is write-protected reads as edited and refuses a further edit."""
    os.setuid(65534)
    with open_session(path) as session:
        if session.names != ("demo_1",):
            return 1
    try:
        editor.undo()
    except DataError as error:
        return 0 if "edits.jsonl cannot be written: Permission denied" in str(error) else 2
    return 3


def test_repair_keeps_the_edits_before_a_damaged_line(path, editor, tmp_path):
    editor.drop("demo_0")
    editor.drop("demo_1")
    log = log_path(path)
    log.write_bytes(log.read_bytes().replace(b'"drop","episode":"demo_1"', b'"drop","episode":"demo_2"'))
    assert [violation.path for violation in validate(path)] == ["s.h5.edits.jsonl"]
    report = repair(path, tmp_path / "r.h5")
    with open_session(tmp_path / "r.h5") as session:
        assert session.names == ("demo_1", "demo_2", "demo_3")
    report = repair(path)
    assert [(loss.path, "damaged in line 3" in loss.message) for loss in report.lost] == [("s.h5.edits.jsonl", True)]
    assert (tmp_path / "s.h5.edits.jsonl.damaged").exists()
    with open_session(path) as session:
        assert session.names == ("demo_1", "demo_2", "demo_3")
    assert validate(path) == ()


def test_a_replaced_or_new_session_has_none_of_the_old_edits(path, editor, tmp_path):
    editor.trim("demo_0", 0, 3)
    editor.drop("demo_1")
    with open_session(path) as session:
        before = session.infos()
    filter_session(path, path, force=True)
    assert not log_path(path).exists()
    with open_session(path) as session:
        assert session.infos() == before
    editor.drop("demo_0")
    path.unlink()
    with pytest.raises(DataError, match=r"s\.h5 is new, but s\.h5\.edits\.jsonl edits an earlier session"):
        write_session(path, [make_episode()])
    with pytest.raises(DataError, match=r"s\.h5\.edits\.jsonl exists"):
        filter_session(write_session(tmp_path / "o.h5", [make_episode()]), path)


def test_recording_continues_beside_edits(path, editor):
    """Names and identities of dropped episodes stay taken, and an edit does not wait for the recording."""
    editor.drop("demo_3")
    first = make_episode(n_steps=5, seed=7)
    with SessionRecorder(path, robot=first.robot, cloth=first.cloth) as recorder:
        assert recorder.save(first).name == "demo_4"
        editor.relabel("demo_4", "failure")
        with open_session(path) as session:
            assert session.info("demo_4").outcome == "failure"
        recorder.save(make_episode(n_steps=5, seed=8))
    with open_session(path) as session:
        assert session.names == ("demo_0", "demo_1", "demo_2", "demo_4", "demo_5")
        assert session.info("demo_4").outcome == "failure"
