"""Folders of tests: they are filled, and what may not change in them is noted."""

import os


def fill(folder, files):
    """Write files, of text or of bytes."""
    for name, content in files.items():
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content if isinstance(content, bytes) else content.encode())


def snapshot(folder):
    """What every file is, without following a link or reading a pipe."""
    return {
        file: file.read_bytes()
        if file.is_file() and not file.is_symlink()
        else (file.lstat().st_mode, file.is_symlink() and os.readlink(file))
        for file in folder.rglob("*")
    }
