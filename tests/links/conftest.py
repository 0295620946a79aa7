"""The scripted copter of the conversations' tests plays the vehicle here too."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "mavlink"))
