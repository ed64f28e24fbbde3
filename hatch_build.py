"""Compiles the library of `dynid.native`, and adapts the README, when the package is built or installed.

With the C compiler of the machine (CC, else cc, gcc or clang), else with that of the package ziglang, which
is then asked for as a requirement of the build. On Windows always with ziglang, unless CC is set: there gcc
does not align vectors on the stack. Where no compiler works the package is built without the library, and
does the same by NumPy.
"""

from __future__ import annotations

import os
import platform
import re
import shlex
import shutil
import subprocess
import sys
import sysconfig
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from hatchling.metadata.plugin.interface import MetadataHookInterface

FOLDER = Path("src/dynid/native")
FLAGS = [
    "-O3",
    "-std=gnu11",
    "-fvisibility=hidden",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-Wno-psabi",
]
# Products and sums are fused, except where arithmetic relies on each rounding.
EVERY_ROUNDING = ("doubled.c", "tape.c")
# The same for processors with wider registers: `dynid_wide` says which one is used.
_AVX2 = ["-mavx2", "-mfma"]
_AVX512 = ["-mavx512f", "-mavx512dq", "-mavx512vl", "-mprefer-vector-width=512"]
VARIANTS = {"library.avx2": _AVX2, "library.avx512": [*_AVX2, *_AVX512]}
SUFFIX = {"win32": "dll", "darwin": "dylib"}.get(sys.platform, "so")
# Code on Windows is position-independent anyway, and has its mathematics in the runtime.
FLAGS += [] if sys.platform == "win32" else ["-fPIC"]
LIBRARIES = [] if sys.platform == "win32" else ["-lm"]
MACOS = "11.0"  # the oldest release that the library is for
# What changes the library without a change of the sources.
CHOSEN = {"CC", "MACOSX_DEPLOYMENT_TARGET"}

# A link or a picture of the README whose target is a file of the project.
LINK = re.compile(r"(?P<picture>!?)\[(?P<text>[^\]]*)\]\((?!\w+:|#)(?P<file>[^)\s]+)\)")


class ReadmeOfIndex(MetadataHookInterface):
    """The README for a package index, where links to files of the project lead nowhere."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Set the README, with links to the repository (URL `Source`); without one, links become text."""
        text = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        text = readme(text, metadata.get("urls", {}).get("Source", ""))
        metadata["readme"] = {"content-type": "text/markdown", "text": text}


def readme(text: str, repository: str) -> str:
    """Return a README whose links lead to a repository; without one, links as texts, no pictures."""

    def replaced(link: re.Match[str]) -> str:
        if not repository:
            return "" if link["picture"] else link["text"]
        view = "raw" if link["picture"] else "blob"
        return f"{link['picture']}[{link['text']}]({repository.rstrip('/')}/{view}/HEAD/{link['file']})"

    return LINK.sub(replaced, text)


def compiler() -> list[str] | None:
    """Return the command of a C compiler, if there is one."""
    if wish := os.environ.get("CC"):
        return shlex.split(wish)
    for name in ("cc", "gcc", "clang") if sys.platform != "win32" else ():
        if found := shutil.which(name):
            return [found]
    return [sys.executable, "-m", "ziglang", "cc"] if find_spec("ziglang") else None


class NativeLibrary(BuildHookInterface):
    """The hook that hatchling calls."""

    def dependencies(self) -> list[str]:
        """Ask for a compiler where the machine has none."""
        return [] if compiler() else ["ziglang"]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:  # noqa: ARG002
        """Compile, and put the library into the wheel (the source archive has none)."""
        if self.target_name != "wheel":
            return
        folder = Path(self.root) / FOLDER
        try:
            wider = VARIANTS if platform.machine().lower() in ("x86_64", "amd64") else {}
            made = [built(folder, name, flags) for name, flags in {"library.plain": [], **wider}.items()]
        except (OSError, subprocess.CalledProcessError) as failure:
            for old in folder.glob("library*"):
                with suppress(OSError):  # Windows removes no library in use
                    old.unlink()
            self.app.display_warning(f"dynid is built without its C library: {failure}")
            self.app.display_warning(str(getattr(failure, "stderr", "")))
            return
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{platform_tag(made)}"
        build_data["artifacts"] += [f"{FOLDER.as_posix()}/{each.name}" for each in made]


def platform_tag(libraries: list[Path]) -> str:
    """Return the tag of the machines that can load libraries: processor, and oldest system.

    On Linux with the GNU C library the oldest version of it that has all functions which they use, as in
    PEP 600; 2.17 at least, since NumPy has no wheels for older ones.
    """
    machine = platform.machine().lower()
    if sys.platform == "darwin":  # compilers build for one processor, also for a Python of two
        return f"macosx_{os.environ.get('MACOSX_DEPLOYMENT_TARGET', MACOS).replace('.', '_')}_{machine}"
    own = re.sub(r"[-.]", "_", sysconfig.get_platform())
    if not own.startswith("linux_") or platform.libc_ver()[0] != "glibc":
        return own
    used = [re.findall(rb"GLIBC_2\.(\d+)", library.read_bytes()) for library in libraries]
    return f"manylinux_2_{max(17, *(int(minor) for some in used for minor in some))}_{own[len('linux_') :]}"


def built(folder: Path, name: str, flags: list[str]) -> Path:
    """Compile the sources in a folder into a library there, unless it is newer than these; return its path.

    The point in its name keeps it from being taken for a module.
    """
    command, target = compiler() or ["cc"], folder / f"{name}.{SUFFIX}"
    sources = sorted(folder.glob("*.c"))
    newest = max(path.stat().st_mtime for path in (*sources, *folder.glob("*.h"), Path(__file__)))
    if target.exists() and target.stat().st_mtime > newest and not CHOSEN & os.environ.keys():
        return target
    environment = os.environ | {"MACOSX_DEPLOYMENT_TARGET": os.environ.get("MACOSX_DEPLOYMENT_TARGET", MACOS)}
    with TemporaryDirectory() as scratch:

        def compiled(source: Path) -> str:
            path = str(Path(scratch) / source.with_suffix(".o").name)
            contracted = "off" if source.name in EVERY_ROUNDING else "fast"
            own = [*FLAGS, *flags, f"-ffp-contract={contracted}", "-c", str(source), "-o", path]
            subprocess.run([*command, *own], check=True, capture_output=True, text=True, env=environment)
            return path

        with ThreadPoolExecutor(os.cpu_count()) as pool:
            objects = list(pool.map(compiled, sources))
        linked = Path(scratch) / target.name  # linkers for Windows leave further files beside it
        link = [*command, *flags, "-shared", *objects, "-o", str(linked), *LIBRARIES]
        subprocess.run(link, check=True, capture_output=True, text=True, env=environment)
        fresh = folder / f".{name}.{os.getpid()}"  # put in place at once: another process may use the old one
        shutil.copy(linked, fresh)
        fresh.replace(target)
    return target
