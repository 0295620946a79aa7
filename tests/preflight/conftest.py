"""Small swarms on the virtual clock are flown here too."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1]))
