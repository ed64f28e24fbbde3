"""Fuzz guided by coverage: `python -m tests.fuzz.guided [SECONDS] [--keep]`, by default 600 of CPU time.

Atheris (libFuzzer) changes scenes and files so that they reach lines of dynid that none before them has
reached. The corpus is made here, of the scenes that come along and of a good file of every format. Half of
the time is for scenes, the other half for files; what breaks something is left in a folder that is named.
"""

from __future__ import annotations

import importlib
import multiprocessing
import os
import pkgutil
import re
import shutil
import sys
import tempfile
import time
from pathlib import Path

#: What is instrumented: everything that meets a user's bytes.
_READING = ("dynid.scene", "dynid.files", "dynid.store", "dynid.hdf5", "dynid.number_format")
_SLOW = 10.0


def scene(data):
    """Read and check a scene."""
    from dynid.scene.load import check_source
    from dynid.scene.yaml.source import parse_source

    check_source(parse_source(data.decode("utf-8", "replace")))


def _targets(folder):
    """Return what is fuzzed: its name, good inputs, and what takes such bytes."""
    from tests.fuzz.files import sources
    from tests.fuzz.mutation import CONFIGS, TEMPLATES

    found = [("scenes", [path.read_bytes() for path in (*CONFIGS, *TEMPLATES)], scene)]
    for name, path, read in sources(folder):
        target = path.with_name(f"fuzzed{path.suffix}")

        def take(data, target=target, read=read):
            target.write_bytes(data)
            read(target)

        found.append((name, [path.read_bytes()], take))
    return found


def _instrument(atheris):
    """Load every module that reads, so that its lines are counted."""
    with atheris.instrument_imports(include=["dynid"]):
        for name in _READING:
            module = importlib.import_module(name)
            for found in pkgutil.walk_packages(getattr(module, "__path__", []), f"{name}."):
                importlib.import_module(found.name)


def _words(inputs):
    """Return a dictionary for libFuzzer: the words of good inputs that are texts."""
    text = b"\n".join(inputs).decode("utf-8", "replace")
    return sorted({word for word in re.findall(r"[A-Za-z_][\w-]{1,30}", text) if word.isascii()})[:3000]


def _fuzz(atheris, target, seconds, folder, report):
    """Fuzz one target until it has had its CPU time; in a process of its own, which libFuzzer ends."""
    from dynid.errors import DynidError

    name, inputs, take = target
    os.dup2(
        os.open(folder / "log", os.O_WRONLY | os.O_CREAT), 2
    )  # libFuzzer tells of every input that is new
    corpus, broken = folder / "corpus", folder / "broken"
    for made in (corpus, broken):
        made.mkdir()
    for place, content in enumerate(inputs):
        (corpus / f"good{place}").write_bytes(content)
    words = folder / "words"
    words.write_text("".join(f'"{word}"\n' for word in _words(inputs)))
    count = {"inputs": 0, "read": 0, "refused": 0, "broken": 0, "slowest": 0.0}
    end = time.process_time() + seconds

    def one(data):
        began = time.process_time()
        if began > end:
            report.send(count | {"corpus": len(list(corpus.iterdir()))})
            os._exit(0)
        count["inputs"] += 1
        try:
            take(data)
            count["read"] += 1
            return
        except DynidError as error:
            count["refused"] += 1
            wrong = "" if str(error).strip() else "no message"
        except Exception as error:
            wrong = f"{type(error).__name__}: {error}"
        took = time.process_time() - began
        count["slowest"] = max(count["slowest"], round(took, 2))
        wrong = wrong or (f"took {took:.1f} s" if took > _SLOW else "")
        if wrong:
            count["broken"] += 1
            place = broken / str(count["broken"])
            place.write_bytes(data)
            print(f"{name}: {wrong[:300]} ({place})", flush=True)

    options = ["-max_len=20000", "-rss_limit_mb=4096", f"-artifact_prefix={broken}/", "-seed=1"]
    if name == "scenes":
        options.append(f"-dict={words}")
    atheris.Setup([name, *options, str(corpus)], one)
    atheris.Fuzz()


def main(seconds: float = 600, *, keep: bool = False) -> int:
    """Fuzz every target, and return how many inputs broke something."""
    try:
        import atheris
    except ImportError:
        print("skipped: Atheris is not installed (pip install atheris)")
        return 0
    _instrument(atheris)  # before anything else loads them
    broken, results, context = 0, {}, multiprocessing.get_context("fork")
    with tempfile.TemporaryDirectory() as good:
        targets = _targets(Path(good))
        for number, target in enumerate(targets):
            name, folder = target[0], Path(tempfile.mkdtemp(prefix="dynid-fuzz-"))
            share = seconds / 2 if number == 0 else seconds / 2 / (len(targets) - 1)
            receiver, sender = context.Pipe(duplex=False)
            child = context.Process(target=_fuzz, args=(atheris, target, share, folder, sender))
            child.start()
            sender.close()
            try:
                results[name] = receiver.recv() | {"seconds": round(share)}
            except EOFError:
                results[name] = {"broken": 1, "seconds": round(share)}
                print(f"{name}: the process died; see {folder}")
            child.join()
            broken += results[name]["broken"]
            print(f"{name:22} {results[name]}", flush=True)
            if not results[name]["broken"]:
                shutil.rmtree(folder)
    if keep:
        from tests.fuzz.record import RECORD, kept_records

        kept_records(RECORD, guided=results)
    return broken


if __name__ == "__main__":
    from tests.fuzz.record import asked

    given = asked(__doc__)
    given.add_argument("seconds", nargs="?", type=float, default=600)
    told = given.parse_args()
    sys.exit(min(main(told.seconds, keep=told.keep), 1))
