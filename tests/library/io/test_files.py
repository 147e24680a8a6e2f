"""Result files are whole or absent, whatever happens while they are written."""

import errno
import os
import signal
import subprocess
import sys
import textwrap

import pytest

from gstlib.errors import OutputError
from gstlib.io.files import check_writable, write_whole


@pytest.mark.parametrize(
    ("step", "code", "words"),
    [
        ("os.fsync", errno.ENOSPC, "the disk is full. Make room"),
        ("os.replace", errno.EIO, "Input/output error. Correct that"),
    ],
)
def test_a_disk_that_fails_is_told_and_leaves_the_old_file(
    tmp_path, monkeypatch, step, code, words
):
    def fail(*_):
        raise OSError(code, os.strerror(code))

    path = tmp_path / "a.bin"
    write_whole(path, b"old")
    monkeypatch.setattr(step, fail)
    with pytest.raises(OutputError, match=rf"a\.bin.*{words}"):
        write_whole(path, b"new")
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["a.bin"]


def test_killed_while_writing(tmp_path):
    """What a killed process leaves is hidden, is not the file, and goes with the next writing."""
    path, other = tmp_path / "new/a[1].bin", tmp_path / "new/.b.bin.1.part"
    write_whole(path, b"old")
    other.write_bytes(b"of another file")
    script = """
        import os, signal, sys
        from gstlib.io.files import write_whole
        os.fsync = lambda _: os.kill(os.getpid(), signal.SIGKILL)
        write_whole(sys.argv[1], b"new" * 1000)
    """
    command = [sys.executable, "-c", textwrap.dedent(script), str(path)]
    killed = subprocess.run(command, check=False)
    assert killed.returncode == -signal.SIGKILL
    assert path.read_bytes() == b"old"
    (left,) = set(os.listdir(path.parent)) - {path.name, other.name}
    assert left.startswith(".a[1].bin.")
    write_whole(path, b"new")
    assert path.read_bytes() == b"new"
    assert set(os.listdir(path.parent)) == {path.name, other.name}


def test_links_and_modes_stay(tmp_path):
    file, link = tmp_path / "there/a.bin", tmp_path / "b.bin"
    write_whole(file, b"old")
    file.chmod(0o640)
    link.symlink_to("there/a.bin")
    write_whole(link, b"new")
    assert (link.is_symlink(), file.read_bytes()) == (True, b"new")
    assert file.stat().st_mode & 0o777 == 0o640
    assert os.listdir(tmp_path / "there") == ["a.bin"]


def test_a_folder_that_cannot_be_written_to(tmp_path):
    check_writable(tmp_path / "new/results")
    assert os.listdir(tmp_path / "new/results") == []
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match=r"file/results.*Not a directory"):
        check_writable(tmp_path / "file/results")
