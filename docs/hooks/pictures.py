"""Pictures of the site that are not kept in the project: drawn before it is built, where they are missing."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

DOCS = Path(__file__).parents[1]
#: Scripts, and a picture of each.
SCRIPTS = {
    "architecture.py": "architecture.svg",
    "accuracy.py": "accuracy/bench-startup-precision.svg",
    "beam_reduction.py": "beam_reduction.svg",
    "gallery.py": "gallery/isolator-bode.svg",
    "remarks.py": "remarks.svg",
    "tables.py": "tables-beam.svg",
}


def on_pre_build(**_: object) -> None:
    """Draw what is missing."""
    for script, picture in SCRIPTS.items():
        if not (DOCS / picture).exists():
            command = [sys.executable, DOCS / script, "--pictures"]
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
