import sys
from pathlib import Path

# `bem_reference.py` beside this file, importable whatever the import mode of pytest.
sys.path.insert(0, str(Path(__file__).parent))
