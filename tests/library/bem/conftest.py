"""Makes `bem_reference` beside this file and `benchmarks/closed_forms.py` importable."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
sys.path.append(str(Path(__file__).parents[3] / "benchmarks"))
