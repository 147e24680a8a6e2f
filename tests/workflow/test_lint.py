"""`snakemake --lint` has nothing to say but what we chose."""

import subprocess
import sys

from conftest import ROOT

# One environment with a locked set of packages serves the whole workflow (see the Makefile): an
# environment for each rule would install the same packages again.
CHOSEN = "* Specify a conda environment or container for each rule.:"


def test_lint():
    result = subprocess.run(
        [sys.executable, "-m", "snakemake", "--snakefile", ROOT / "Snakefile", "--lint"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    lints = [line.strip() for line in result.stderr.splitlines() if line.startswith("    * ")]
    assert CHOSEN in lints  # the linter ran, and its words are as we know them
    assert [lint for lint in lints if lint != CHOSEN] == []
