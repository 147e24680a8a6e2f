"""What steps made, and what is no longer so."""

import os

import pytest
from gst.made import check_made, read_records, record_made
from gstlib.errors import InputError


def test_of_two_records_of_a_file_the_newer_counts(tmp_path):
    """As after a change of `patches_per_job`; in whichever order their names are."""
    file = tmp_path / "7.h5"
    for number, names in enumerate(("ab", "ba")):
        for age, name in enumerate(names):
            file.write_text(f"{number}{name}")
            record_made([tmp_path], record := tmp_path / f".{name}.sha256")
            os.utime(record, ns=(age, age))
        made = read_records(tmp_path.glob(".*.sha256"))
        check_made(made)
        assert made[file].output == tmp_path
        file.write_text("another")
        with pytest.raises(InputError, match=r"7\.h5: is not as its step made it"):
            check_made(made)


@pytest.mark.parametrize(
    ("count", "date", "seen"),
    [(9, 0, "always"), (2**21, 0, "thoroughly"), (2**21, 2**62, "always")],
)
def test_a_large_file_is_compared_if_it_is_younger_or_thoroughly(tmp_path, count, date, seen):
    file = tmp_path / "contact.h5"
    file.write_bytes(bytes(count))
    record_made([file], tmp_path / "log.sha256")
    made = read_records([tmp_path / "log.sha256"])
    file.write_bytes(bytes(count - 1) + b"1")
    os.utime(file, ns=(date, date))
    for thoroughly in (True, False):
        if thoroughly or seen == "always":
            with pytest.raises(InputError):
                check_made(made, thoroughly=thoroughly)
        else:
            check_made(made, thoroughly=thoroughly)
