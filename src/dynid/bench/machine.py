"""The machine that measures: processor, cores, Python, NumPy and its BLAS."""

from __future__ import annotations

import platform
from pathlib import Path

from dynid.number_format import counted
from dynid.study.executors.base import cores


def machine() -> str:
    """Return processor, cores, system, Python, NumPy and its BLAS as text, each as it names itself."""
    import numpy as np

    info = Path("/proc/cpuinfo")
    text = info.read_text(encoding="utf-8", errors="replace") if info.exists() else ""
    models = [line.partition(":")[2].strip() for line in text.splitlines() if line.startswith("model name")]
    chip = next(iter(models), "") or platform.processor() or platform.machine()
    blas = np.show_config(mode="dicts").get("Build Dependencies", {}).get("blas", {})
    algebra = " ".join(str(blas.get(key, "")) for key in ("name", "version")).strip() or "unknown BLAS"
    return (
        f"{chip}, {counted(cores(), 'core')}, {platform.system()}, Python {platform.python_version()}, "
        f"NumPy {np.__version__} ({algebra})"
    )
