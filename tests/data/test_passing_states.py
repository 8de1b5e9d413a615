"""A file that is open elsewhere, left marked, or on a poor or full disk is not damaged, and its data are kept."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import h5py
import pytest

from layflat.data import DataError, SessionRecorder, open_session, repair, validate
from layflat.data.atomic_files import WriterLock, is_locked, write_text
from layflat.data.format import superblock
from layflat.data.format.opening import FileBusyError, FileMarkedError, errors_name
from layflat.data.session.parts import parts_folder
from layflat.data.system_errors import os_reason
from layflat.data.tools.operations import merge
from layflat.tests.factories import HANGER, differences, make_episode, write_session

OPEN = "import h5py, os, sys; file = h5py.File(sys.argv[1], 'r+'); {change}; print('open', flush=True); {then}"
KILLED, WAITS = "os.kill(os.getpid(), 9)", "sys.stdin.read()"


def leave_open(path: Path, change: str = "0") -> None:
    """Open a file for writing in another process, which is then killed."""
    subprocess.run([sys.executable, "-c", OPEN.format(change=change, then=KILLED), str(path)], check=False)


@contextmanager
def held_open(path: Path, **environment: str):
    """Another process has the file open for writing, as a notebook may."""
    words = [sys.executable, "-c", OPEN.format(change="0", then=WAITS), str(path)]
    pipe = subprocess.PIPE
    with subprocess.Popen(words, stdin=pipe, stdout=pipe, env=os.environ | environment) as process:
        assert process.stdout.readline() == b"open\n"
        yield process.pid
        process.stdin.close()


@pytest.fixture
def path(tmp_path) -> Path:
    return write_session(tmp_path / "s.h5", [make_episode(seed=seed) for seed in range(3)])


def test_the_checksum_is_that_of_its_author():
    """Values of lookup3.c's own self-test."""
    assert superblock.lookup3(b"") == 0xDEADBEEF
    assert superblock.lookup3(b"Four score and seven years ago") == 0x17770551


def test_a_stale_mark_is_said_and_removed_to_the_byte(path, tmp_path):
    before = path.read_bytes()
    leave_open(path)
    marked = path.read_bytes()
    assert sum(a != b for a, b in zip(before, marked, strict=True)) == 5
    for use in (open_session, validate, lambda p: SessionRecorder(p, robot=HANGER, cloth="towel")):
        with pytest.raises(FileMarkedError, match=r"marked as open for writing.*data repair") as caught:
            use(path)
        assert "record" not in str(caught.value)
    report = repair(path, tmp_path / "copy.h5")
    assert (report.intact, report.lost) == (("demo_0", "demo_1", "demo_2"), ())
    assert path.read_bytes() == marked
    assert (tmp_path / "copy.h5").read_bytes() == before
    assert repair(path).original is None
    assert path.read_bytes() == before
    assert sorted(p.name for p in tmp_path.iterdir()) == ["copy.h5", "s.h5"]


def test_what_a_killed_program_had_added_is_kept(path):
    leave_open(path, "file['notes'] = [1, 2, 3]; file['data/demo_1'].create_group('mine'); file.flush()")
    assert repair(path).lost == ()
    with h5py.File(path) as file:
        assert file["notes"][()].tolist() == [1, 2, 3]
        assert "mine" in file["data/demo_1"]
    with open_session(path) as session:
        assert [differences(a, make_episode(seed=seed)) for seed, a in enumerate(session)] == [[]] * 3


def test_a_marked_file_that_is_damaged_too_is_saved_as_far_as_it_is_whole(path):
    leave_open(path)
    content = bytearray(path.read_bytes())
    with h5py.File.in_memory(superblock.without_mark(bytes(content[:48])) + bytes(content[48:])) as file:
        at = file["data/demo_1/action_m"].id.get_chunk_info(0).byte_offset
    content[at] ^= 1
    path.write_bytes(content)
    report = repair(path)
    assert report.intact == ("demo_0", "demo_2")
    assert report.original == path.with_name("s.h5.damaged")
    assert report.original.read_bytes() == content
    assert validate(path) == ()


def test_a_marked_file_and_episodes_that_are_not_yet_in_it(path, tmp_path):
    other = write_session(tmp_path / "o.h5", [make_episode(seed=7)])
    leave_open(path)
    parts_folder(path).mkdir()
    shutil.move(other, parts_folder(path) / "demo_3.h5")
    assert repair(path).intact == ("demo_0", "demo_1", "demo_2", "demo_3")
    assert validate(path) == ()


@pytest.mark.parametrize("environment", [{}, {"HDF5_USE_FILE_LOCKING": "FALSE"}])
def test_a_file_that_is_open_elsewhere(path, environment, monkeypatch):
    monkeypatch.chdir(path.parent)
    path = Path(path.name)
    before = path.read_bytes()
    with held_open(path, **environment) as pid:
        held = path.read_bytes()
        for use in (open_session, validate, repair):
            with pytest.raises(
                FileBusyError, match=rf"^{path} is open for writing in another program \(.*, process {pid}\)"
            ):
                use(path)
        assert path.read_bytes() == held
    assert path.read_bytes() == before
    assert validate(path) == ()


def test_a_session_that_a_notebook_opens_while_it_is_recorded(path, caplog):
    """Nothing failed: the episodes are durable beside the file, and are in the session when it is closed there."""
    recorder = SessionRecorder(path, robot=HANGER, cloth="towel")
    with held_open(path):
        assert recorder.save(make_episode(seed=9)).name == "demo_3"
        recorder.close()
    (record,) = caplog.records
    assert "the new episodes are safe" in record.getMessage()
    with open_session(path) as session:
        assert session.names == ("demo_0", "demo_1", "demo_2", "demo_3")
    SessionRecorder(path, robot=HANGER, cloth="towel").close()
    assert not parts_folder(path).exists()


def test_an_absent_writer_s_mark_is_no_sign_of_one(path):
    """A superblock whose checksum is wrong is damage, with any mark."""
    content = bytearray(path.read_bytes())
    content[11] = 1
    path.write_bytes(content)
    with pytest.raises(DataError, match="damaged or cut short"):
        open_session(path)


FILL = """
import sys
from pathlib import Path
from resource import RLIM_INFINITY, RLIMIT_FSIZE, setrlimit
from layflat.data import open_session
from layflat.data.exchange.robomimic import export_robomimic
from layflat.data.tools.operations import filter_session, merge, trim
from layflat.data.tools.repair import repair

source, out, count = Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])

def export(path, target):
    with open_session(path) as session:
        export_robomimic(session, target, seed=0)

calls = [
    lambda: merge([source], out),
    lambda: filter_session(source, out),
    lambda: trim(source, out, name="demo_0", start=0, stop=3),
    lambda: repair(source, out),
    lambda: export(source, out),
]
size = source.stat().st_size
refused = 0
for call in calls:
    for limit in (100, *range(2000, size, size // count), size - 500, 2 * size):
        setrlimit(RLIMIT_FSIZE, (limit, RLIM_INFINITY))
        try:
            call()
        except (OSError, ValueError) as error:
            assert "File too large" in str(error), error
            assert not out.exists()
            refused += 1
        setrlimit(RLIMIT_FSIZE, (RLIM_INFINITY, RLIM_INFINITY))
        out.unlink(missing_ok=True)
        assert list(out.parent.iterdir()) == []
print(refused)
"""


@pytest.mark.parametrize("count", [2, pytest.param(14, marks=pytest.mark.slow)])
def test_a_disk_that_fills_up_while_sessions_are_copied(tmp_path, count):
    """The library once freed memory twice there, at the latest when the process ended."""
    source = write_session(tmp_path / "s.h5", [make_episode(seed=s, n_steps=20, images=True) for s in range(3)])
    (tmp_path / "out").mkdir()
    words = [sys.executable, "-c", FILL, str(source), str(tmp_path / "out" / "o.h5"), str(count)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert int(done.stdout) > 4 * count


def test_a_copy_is_the_same_as_on_an_ordinary_disk(path, tmp_path):
    merge([path], tmp_path / "m.h5")
    with open_session(path) as one, open_session(tmp_path / "m.h5") as other:
        assert [differences(a, b) for a, b in zip(one, other, strict=True)] == [[]] * 3


POOR_DISK = """
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <stdlib.h>
#include <sys/stat.h>
int fsync(int fd) {
    struct stat s;
    if (fstat(fd, &s) == 0 && S_ISDIR(s.st_mode)) { errno = EINVAL; return -1; }
    return ((int (*)(int))dlsym(RTLD_NEXT, "fsync"))(fd);
}
int flock(int fd, int operation) { errno = atoi(getenv("NO_LOCKS")); return -1; }
"""
RECORD = """
import sys
from layflat.data import DataError, SessionRecorder, open_session, repair, validate
from layflat.tests.factories import HANGER, make_episode, write_session

path = sys.argv[1]
with SessionRecorder(path, robot=HANGER, cloth="towel") as recorder:
    recorder.save(make_episode())
    try:
        SessionRecorder(path, robot=HANGER, cloth="towel")
    except DataError as error:
        print(error)
write_session(path, [make_episode(seed=1)])
print(len(open_session(path)), len(validate(path)), len(repair(path).intact))
"""


@pytest.mark.parametrize(
    "number", [errno.ENOLCK, *(pytest.param(n, marks=pytest.mark.slow) for n in (errno.EOPNOTSUPP, errno.ENOSYS))]
)
def test_a_drive_without_locks_and_flushed_folders(tmp_path, number):
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("there is no C compiler")
    (tmp_path / "poor.c").write_text(POOR_DISK)
    library = tmp_path / "poor.so"
    subprocess.run([compiler, "-shared", "-fPIC", "-o", library, tmp_path / "poor.c", "-ldl"], check=True)
    environment = os.environ | {"LD_PRELOAD": str(library), "NO_LOCKS": str(number)}
    words = [sys.executable, "-c", RECORD, str(tmp_path / "s.h5")]
    done = subprocess.run(words, env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    second, counts = done.stdout.splitlines()
    assert "is being written by another program" in second
    assert counts == "2 0 2"


def test_a_lock_of_a_process_that_has_ended_is_taken_over_where_there_are_no_locks(tmp_path, monkeypatch):
    def no_locks(*_):
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr("fcntl.flock", no_locks)
    with subprocess.Popen([sys.executable, "-c", ""]) as ended:
        ended.wait()
    folder = tmp_path / "parts"
    folder.mkdir()
    (folder / "lock").write_text(f"{ended.pid} {os.uname().nodename}")
    WriterLock(folder, tmp_path / "s.h5").release()
    folder.mkdir()
    (folder / "lock").write_text(f"{ended.pid} another-machine")
    with pytest.raises(DataError, match=r"being written by another program.*or delete .*lock if it has ended"):
        WriterLock(folder, tmp_path / "s.h5")


@pytest.mark.parametrize("number", [errno.EINVAL, errno.ENOTSUP, errno.EACCES, errno.EIO])
def test_what_is_in_place_is_not_reported_as_failed(tmp_path, monkeypatch, caplog, number):
    real = os.fsync

    def fsync(descriptor):
        if os.path.isdir(f"/proc/self/fd/{descriptor}"):
            raise OSError(number, os.strerror(number))
        real(descriptor)

    monkeypatch.setattr(os, "fsync", fsync)
    write_text(tmp_path / "a.txt", "whole")
    assert (tmp_path / "a.txt").read_text() == "whole"
    assert len(caplog.records) == (number == errno.EIO)


def test_errors_of_the_system_are_named_and_say_what_helps(tmp_path):
    """Also those that HDF5 has wrapped; none of them is damage."""
    for number, words in {
        errno.ENOSPC: "free some space",
        errno.EDQUOT: "your quota is full",
        errno.EFBIG: "ulimit -f",
        errno.EROFS: "read-only",
        errno.EIO: "copy what is on it",
        errno.ESTALE: "connect it again",
        errno.EMFILE: "ulimit -n",
    }.items():
        wrapped = RuntimeError(f"file read failed: time = now, errno = {number}, error message = 'x'")
        for error in (OSError(number, "x"), wrapped):
            assert os_reason(error).startswith(os.strerror(number))
            assert words in os_reason(error)
        with pytest.raises(DataError, match="cannot be read") as caught, errors_name(tmp_path / "s.h5"):
            raise OSError(str(wrapped))
        assert "damaged" not in str(caught.value)
    with pytest.raises(DataError, match="not enough memory"), errors_name(tmp_path / "s.h5"):
        raise MemoryError


def test_only_a_writer_s_lock_counts(path):
    with h5py.File(path):
        assert not is_locked(path)
    with held_open(path):
        assert is_locked(path)
    assert not is_locked(path.with_name("absent.h5"))
