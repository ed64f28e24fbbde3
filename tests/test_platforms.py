"""Windows and macOS, with what they lack simulated here: system calls, encodings, open files, libraries."""

import ctypes
import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from dynid import file_access
from dynid.errors import FileError
from dynid.scene.yaml.source import read_source

ROOT = Path(__file__).parents[1]

# What a process on Windows has not, or refuses; files that are written without an encoding are an error.
WINDOWS = """
import os, signal, sys, warnings
warnings.filterwarnings("error", category=EncodingWarning, module="dynid")
import types, filelock
sys.modules[filelock.UnixFileLock.__module__].os = types.SimpleNamespace(**vars(os))
for name in ("fork", "pread", "pwrite", "sched_getaffinity", "O_NOFOLLOW", "O_CLOEXEC", "O_NONBLOCK"):
    delattr(os, name)
del signal.SIGALRM, signal.setitimer
sys.modules["fcntl"] = sys.modules["resource"] = None
is_open = lambda path: any(
    os.path.exists(file) and os.path.realpath(file) == os.path.realpath(path)
    for file in (f"/proc/self/fd/{fd}" for fd in os.listdir("/proc/self/fd"))
)
def unless_open(change):
    def changed(*paths, **more):
        for path in paths:
            if isinstance(path, str) and is_open(path):
                raise PermissionError(13, "The process cannot access the file", path)
        return change(*paths, **more)
    return changed
os.replace, os.unlink = unless_open(os.replace), unless_open(os.unlink)
real_open = os.open
def open_no_folder(path, *more, **others):
    if os.path.isdir(path):
        raise PermissionError(13, "Permission denied", path)
    return real_open(path, *more, **others)
os.open = open_no_folder
from dynid.cli import main
main(sys.argv[1:])
"""


def windows(folder, *args):
    """Run a command as on Windows, with the code page of Western Europe."""
    return subprocess.run(
        [sys.executable, "-X", "warn_default_encoding", "-c", WINDOWS, *args],
        cwd=folder,
        capture_output=True,
        check=False,
        timeout=600,
        env={"PYTHONIOENCODING": "cp1252", "PATH": "", "LC_ALL": "C", "PYTHONPATH": str(ROOT / "src")},
    )


SCENE = """dynid: 1
kind: bond-graph
title: Größe ω
graph:
  nodes: {F: Se, body: 1, m: {type: I, value: 2}, b: {type: R, value: 4}}
  bonds: [F -> body -> m, body -> b]
analysis: {inputs: [F], outputs: [m.f], results: [poles]}
"""
STUDY = """dynid: 1
kind: study
scene: scene.yaml
vary: {graph.nodes.m.value: {values: [1, 2, 4]}}
sampling: {method: grid}
collect: [bond_graph/transfer_function/m.f/F/poles]
"""


@pytest.fixture
def scenes(tmp_path):
    (tmp_path / "scene.yaml").write_text(SCENE, encoding="utf-8")
    (tmp_path / "study.yaml").write_text(STUDY, encoding="utf-8")
    return tmp_path


@pytest.mark.thorough
def test_runs_studies_and_reports_need_nothing_that_windows_lacks(scenes):
    done = windows(scenes, "run", "scene.yaml", "--report", "scene.html")
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"poles   -2 rad/s" in done.stdout
    assert "Größe ?".encode("cp1252") in done.stdout  # what the code page has not is marked
    assert "Größe ω" in (scenes / "scene.html").read_text(encoding="utf-8")
    for _ in range(2):  # the second time it is complete
        done = windows(scenes, "study", "study.yaml", "--executor", "serial", "-q")
        assert (done.returncode, done.stderr) == (0, b"")
    assert not (scenes / "study.h5.journal").exists()


def test_a_folder_in_place_of_a_scene_is_named_where_opening_one_is_denied(tmp_path):
    done = windows(tmp_path, "run", str(tmp_path))
    assert done.returncode == 4
    assert b"is a directory, not a scene file" in done.stderr


def test_bytes_are_read_and_written_at_a_place_without_calls_for_it(tmp_path, monkeypatch):
    monkeypatch.delattr("os.pread")
    monkeypatch.delattr("os.pwrite")
    (tmp_path / "f").write_bytes(b"0123456789")
    descriptor = file_access.descriptor_of(str(tmp_path / "f"))
    with os.fdopen(descriptor, "rb"):
        assert file_access.write_at(descriptor, memoryview(b"\r\n\x1a"), 4) == 3
        assert file_access.read_at(descriptor, 100, 3) == b"3\r\n\x1a789"


def test_no_link_is_followed_where_the_system_cannot_refuse_it(tmp_path, monkeypatch):
    monkeypatch.setattr(file_access, "_NO_LINK", 0)
    (tmp_path / "mine").write_text("my diary")
    (tmp_path / "link").symlink_to(tmp_path / "mine")
    with pytest.raises(OSError, match="symbolic links"):
        file_access.descriptor_of(str(tmp_path / "link"))


def test_a_folder_is_no_scene(tmp_path):
    with pytest.raises(FileError, match="is a directory, not a scene file"):
        read_source(tmp_path)


# --- the library of C ------------------------------------------------------------------------------


@pytest.fixture
def hook(monkeypatch):
    """Return a function that imports the build hook as on another system."""

    def on(system, machine="x86_64"):
        monkeypatch.setattr(sys, "platform", system)
        monkeypatch.setattr("platform.machine", lambda: machine)
        monkeypatch.delenv("CC", raising=False)
        monkeypatch.delenv("MACOSX_DEPLOYMENT_TARGET", raising=False)
        spec = importlib.util.spec_from_file_location("hatch_build", ROOT / "hatch_build.py")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    interface = SimpleNamespace(BuildHookInterface=object)
    metadata = SimpleNamespace(MetadataHookInterface=object)
    monkeypatch.setitem(sys.modules, "hatchling.metadata.plugin.interface", metadata)
    monkeypatch.setitem(sys.modules, "hatchling.builders.hooks.plugin.interface", interface)
    return on


@pytest.mark.parametrize(
    ("system", "machine", "own", "tag"),
    [
        ("win32", "AMD64", "win-amd64", "win_amd64"),
        ("darwin", "arm64", "macosx-10.13-universal2", "macosx_11_0_arm64"),
        ("darwin", "x86_64", "macosx-10.13-x86_64", "macosx_11_0_x86_64"),
        ("linux", "x86_64", "linux-x86_64", "manylinux_2_29_x86_64"),
        ("linux", "aarch64", "linux-aarch64", "manylinux_2_29_aarch64"),
    ],
)
def test_a_wheel_is_for_the_machines_that_can_load_its_library(
    hook, monkeypatch, tmp_path, system, machine, own, tag
):
    module = hook(system, machine)
    monkeypatch.setattr("sysconfig.get_platform", lambda: own)
    monkeypatch.setattr("platform.libc_ver", lambda: ("glibc", "2.41"))
    library = tmp_path / "library"
    library.write_bytes(b"\0GLIBC_2.2.5\0GLIBC_2.29\0GLIBC_2.14\0")
    assert module.platform_tag([library]) == tag
    library.write_bytes(b"\0GLIBC_2.2.5\0")
    if system == "linux":
        assert module.platform_tag([library]) == f"manylinux_2_17_{machine}"
        monkeypatch.setattr("platform.libc_ver", lambda: ("", ""))  # musl
        assert module.platform_tag([library]) == f"linux_{machine}"


def test_on_windows_the_library_is_compiled_by_ziglang(hook, monkeypatch):
    module = hook("win32", "AMD64")
    monkeypatch.setattr(module, "find_spec", lambda _: None)
    assert module.compiler() is None
    assert module.NativeLibrary.dependencies(None) == ["ziglang"]
    monkeypatch.setattr(module, "find_spec", lambda _: True)
    assert module.compiler()[1:] == ["-m", "ziglang", "cc"]
    assert (module.SUFFIX, module.LIBRARIES, "-fPIC" in module.FLAGS) == ("dll", [], False)


def test_a_library_is_compiled_when_a_source_is_newer(hook, monkeypatch, tmp_path):
    module = hook("linux")
    if module.compiler() is None:
        pytest.skip("no C compiler")
    source = tmp_path / "answer.c"
    source.write_text(code := '__attribute__((visibility("default"))) int answer(void) { return 42; }')

    def answer():
        library = module.built(tmp_path, "library.plain", ["-O0"])
        copy = shutil.copy(library, tmp_path / f"{len(list(tmp_path.iterdir()))}.so")  # none is loaded twice
        return ctypes.CDLL(str(copy)).answer()

    assert answer() == 42
    before = (tmp_path / "library.plain.so").stat().st_mtime
    source.write_text(code.replace("42", "43"))
    os.utime(source, (before - 1,) * 2)
    assert answer() == 42
    os.utime(source, (before + 1,) * 2)
    assert answer() == 43
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(OSError, match="no-such-compiler"):
        answer()


def test_links_of_the_readme_lead_somewhere_on_a_package_index(hook):
    module = hook("linux")
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    files = [link["file"] for link in module.LINK.finditer(text)]
    assert len(files) > 10
    assert all((ROOT / file).exists() for file in files)
    there = module.readme(text, "https://example.org/dynid/")
    assert not module.LINK.search(there)
    assert "[architecture](https://example.org/dynid/blob/HEAD/docs/architecture.md)" in there
    assert "](https://example.org/dynid/raw/HEAD/docs/overview.png)" in there
    bare = module.readme(text, "")  # no repository is known: no dead link
    assert "](" not in bare
    assert "developers: architecture, CONTRIBUTING.md" in bare
