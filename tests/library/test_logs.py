import logging
import warnings

import pytest

from gstlib.errors import InputError
from gstlib.logs import job_log


def test_user_errors_are_one_line(tmp_path, capsys):
    with (
        pytest.raises(SystemExit) as ended,
        job_log(tmp_path / "logs/job.log"),
    ):
        raise InputError("scan.plu", "is empty", "Copy it again.")
    assert ended.value.code == 1
    assert capsys.readouterr().err.strip() == "ERROR: scan.plu: is empty. Copy it again."
    log = (tmp_path / "logs/job.log").read_text()
    assert log == "ERROR scan.plu: is empty. Copy it again.\n"


def test_faults_of_the_program_keep_their_traceback(tmp_path, capsys):
    with pytest.raises(SystemExit), job_log(tmp_path / "job.log"):
        raise ZeroDivisionError("oops")
    assert "Traceback" in capsys.readouterr().err
    assert "oops" in (tmp_path / "job.log").read_text()


def test_warnings_reach_the_log(tmp_path, capsys):
    with job_log(tmp_path / "job.log"):
        logging.getLogger("gstlib.anything").info("step 1")
        warnings.warn("contact at the border", UserWarning, stacklevel=1)
    assert (tmp_path / "job.log").read_text().splitlines() == [
        "INFO step 1",
        "WARNING UserWarning: contact at the border",
    ]
    assert "contact at the border" in capsys.readouterr().err
