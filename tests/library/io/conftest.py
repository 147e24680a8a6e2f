"""Files with any content, and samples of the formats of scans."""

import pytest
from scan_files import FORMATS, HEIGHTS, OPTIONS


@pytest.fixture
def write(tmp_path):
    """Write a file of this name, of bytes or of text in UTF-8."""

    def write(name, content):
        is_text = isinstance(content, str)
        (tmp_path / name).write_bytes(content.encode() if is_text else content)
        return tmp_path / name

    return write


@pytest.fixture
def sample(tmp_path):
    """Write heights in a format, and tell what `read_scan` must be given to read the file."""

    def sample(name, heights=HEIGHTS):
        ending = name.partition(",")[0]
        path = tmp_path / f"a.{ending}"
        FORMATS[name](path, heights)
        return path, OPTIONS.get(ending, {})

    return sample
