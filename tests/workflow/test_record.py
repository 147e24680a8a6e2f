"""The package of a study, by the validator of its profile."""

import importlib.util
from pathlib import Path

import pytest
from gst.crate import pack_study

pytestmark = pytest.mark.slow

CONTEXT = "https://w3id.org/ro/crate/1.1/context"


@pytest.fixture
def cache(tmp_path):
    """What the validator would take from the network: one file, which `rocrate` ships."""
    pytest.importorskip("rocrate_validator", reason="needs `pip install '.[record]'`")
    from requests_cache import CachedRequest, CachedResponse, CachedSession

    (package,) = importlib.util.find_spec("rocrate").submodule_search_locations
    answer = CachedResponse(
        url=CONTEXT,
        status_code=200,
        headers={"Content-Type": "application/ld+json"},
        request=CachedRequest(method="GET", url=CONTEXT),
    )
    answer._content = (Path(package) / "data/ro-crate.jsonld").read_bytes()
    assert f'"@id": "{CONTEXT}"'.encode() in answer._content
    with CachedSession(str(tmp_path / "cache"), backend="sqlite") as session:
        session.cache.save_response(answer)
    return tmp_path / "cache"


def test_a_package_is_a_workflow_run_crate(finished_tiny, cache, tmp_path, monkeypatch):
    from rocrate_validator.models import Severity
    from rocrate_validator.services import validate

    monkeypatch.chdir(finished_tiny.folder)
    pack_study(finished_tiny.results, tmp_path / "study.zip")
    result = validate(
        {
            "rocrate_uri": str(tmp_path / "study.zip"),
            "profile_identifier": "workflow-run-crate-0.5",
            "requirement_severity": Severity.REQUIRED,
            "offline": True,
            "cache_path": cache,
        }
    )
    assert [issue.message for issue in result.get_issues()] == []
    assert len(result.executed_checks) > 50
    assert not result.skipped_checks
