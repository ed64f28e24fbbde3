"""Tell whether archives hold just what the project holds: `contents.py FILE.whl FILE.tar.gz`."""

import subprocess
import sys
import tarfile
import zipfile
from pathlib import PurePosixPath


def tracked(*folders: str) -> set[str]:
    """Return the files that the project consists of."""
    listed = subprocess.run(["git", "ls-files", "-z", *folders], check=True, capture_output=True, text=True)
    return set(listed.stdout.strip("\0").split("\0"))


def main(wheel: str, archive: str) -> int:
    """Compare both with what git tracks; return the exit code."""
    with zipfile.ZipFile(wheel) as file:
        packed = {name for name in file.namelist() if ".dist-info/" not in name}
        packed -= {name for name in packed if name.startswith("dynid/native/library")}  # compiled
    with tarfile.open(archive) as file:
        parts = [PurePosixPath(member.name).parts[1:] for member in file if member.isfile()]
        sources = {"/".join(each) for each in parts} - {"PKG-INFO"}
    package = {name.removeprefix("src/") for name in tracked("src/dynid")}
    return compared(wheel, packed, package) | compared(archive, sources, tracked())


def compared(archive: str, packed: set[str], expected: set[str]) -> int:
    """Print what an archive lacks and what it should not have; return 1 if there is anything."""
    for name in sorted(expected - packed):
        print(f"{archive} lacks {name}")
    for name in sorted(packed - expected):
        print(f"{archive} should not have {name}")
    print(f"{PurePosixPath(archive).name}: {len(packed)} files, compared with what git tracks")
    return int(packed != expected)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
