"""Shared by all tests: helpers beside them can be imported, and runs never meet a terminal's colours."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
