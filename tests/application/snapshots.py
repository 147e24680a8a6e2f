"""What lies in a folder, for tests of what may not change there."""

import os


def snapshot(folder):
    """What every file is, without following a link or reading a pipe."""
    return {
        file: file.read_bytes()
        if file.is_file() and not file.is_symlink()
        else (file.lstat().st_mode, file.is_symlink() and os.readlink(file))
        for file in folder.rglob("*")
    }
