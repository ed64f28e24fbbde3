"""Measure the costs of large studies and write docs/scaling.md: `python docs/scaling.py`.

Every number in the page is measured here, or follows from what is measured here by the formulas in it.
"""

from __future__ import annotations

import os
import pickle
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, wait
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")  # a process a core: threads would only wait for each other

import numpy as np
from distributed import Client, LocalCluster

from dynid.scene.batch import run_batch
from dynid.scene.load import load_scene
from dynid.scene.outcomes import SampleBlock, SampleOutcomes
from dynid.study.executors import StudyExecutor
from dynid.study.file import write_study
from dynid.study.journal import Journal
from dynid.study.keys import SIZE, sample_keys
from dynid.study.plan import make_plan
from dynid.study.run import heading_of
from dynid.study.scheduler import Chunk, Chunks, Scheduler
from dynid.study.work import Done, Job, meets, packed, unpacked

HERE = Path(__file__).parent
STUDY = """\
dynid: 1
kind: study
scene: {scene}
vary:
  parameters.m_s: {{distribution: uniform, low: 8, high: 12}}
  parameters.b: {{distribution: uniform, low: 20, high: 80}}
  parameters.I_f: {{distribution: uniform, low: 1.5e4, high: 2.5e4}}
  parameters.C_a: {{distribution: uniform, low: 0.8e-8, high: 1.2e-8}}
sampling: {{method: random, samples: {samples}, seed: 1}}
collect: [bond_graph/properties, bond_graph/transfer_function/m_s.f/v_in/zeros,
          bond_graph/transfer_function/m_s.f/v_in/poles]
"""
SIZES = (1_000_000, 100_000_000)
WORKERS = (10, 1000)
HEADINGS = (
    "a sample takes", "samples", "workers", "computing", "chunk", "scheduler", "client", "keys", "file",
    "in one piece", "first to saturate", "shards", "with shards",
)  # fmt: skip
MOST = 10_000_000  # samples of one study
QUICK = "--quick" in sys.argv  # less of everything, for the test that this script runs


@dataclass(frozen=True)
class Costs:
    """What was measured, in seconds and bytes."""

    sample: float  # compute, of one sample among many
    prepare: float  # plan and key of one sample, before the start
    message: float  # what one task costs the scheduler and the client's loop
    code: float  # pickling and unpickling one outcome
    byte: float  # moving one byte from worker to client
    journal: float  # one sample into the journal
    sync: float  # one append to the journal, whatever is in it
    file: float  # one sample into the file
    size: float  # bytes of one outcome between processes
    stored: float  # bytes of one sample in the file

    @property
    def client(self) -> float:
        """What one sample costs the process that collects them."""
        return self.code + self.size * self.byte + self.journal


def timed(call: Callable[[], Any], repeat: int = 3, clock: Callable[[], float] = time.process_time) -> float:
    """Return the shortest time of several calls; by default only what processors did in this process."""
    times = []
    for _ in range(repeat):
        started = clock()
        call()
        times.append(clock() - started)
    return min(times)


class Repeated:
    """The same outcomes again and again."""

    def __init__(self, outcomes: SampleOutcomes) -> None:
        self.outcomes = outcomes

    def between(self, start: int, stop: int) -> Iterator[SampleBlock]:
        """Yield some rows."""
        rows = np.arange(start, stop)
        return self.outcomes.picked(rows % len(self.outcomes), rows)


def measure(folder: Path, client: Client) -> tuple[Costs, SampleOutcomes]:
    """Measure all costs with a study of the isolator, one after the other."""
    count = 300 if QUICK else 20_000
    study = folder / "study.yaml"
    study.write_text(STUDY.format(scene=HERE.parent / "configs/isolator.yaml", samples=count))
    scene = load_scene(study)
    prepare = timed(lambda: sample_keys(make_plan(scene), range(count)), 2) / count
    plan = make_plan(scene)
    keys = sample_keys(plan, range(count))
    batch = plan.overrides(range(200 if QUICK else 1000))
    run_batch(plan.base, batch[:10], plan.collect, meets)  # what is loaded once
    sample = timed(lambda: packed(run_batch(plan.base, batch, plan.collect, meets))) / len(batch)
    outcomes = run_batch(plan.base, batch, plan.collect, meets)
    content = pickle.dumps(Done(packed(outcomes), 0.0))
    code = timed(lambda: pickle.loads(pickle.dumps(Done(packed(outcomes), 0.0)))) / len(outcomes)
    journal = Journal(str(folder / "j.journal"))
    one, all_of_them = packed(SampleOutcomes.of(outcomes[:1])), packed(outcomes)
    sync = timed(lambda: journal.append([(keys[:1], one)]), 20, time.perf_counter)
    per_sample = timed(lambda: journal.append([(keys[: len(batch)], all_of_them)])) / len(batch)
    journal.close()
    target = folder / "f.h5"
    heading, rows = heading_of(plan, range(count), keys), Repeated(outcomes)
    write = timed(lambda: write_study(target, heading, rows.between), 2)
    message, byte = messages(client)
    costs = Costs(
        sample, prepare, message, code, byte, per_sample, sync, write / count,
        len(content) / len(outcomes), target.stat().st_size / count,
    )  # fmt: skip
    return costs, outcomes


def cluster_of(threads: int) -> LocalCluster:
    """Return a scheduler in this process, and a worker of so many threads in another."""
    return LocalCluster(n_workers=1, threads_per_worker=threads, processes=True, dashboard_address=None)


def nothing(size: int) -> bytes:
    """Return so many bytes, at once."""
    return bytes(size)


def messages(client: Client, clock: Callable[[], float] = time.process_time) -> tuple[float, float]:
    """Return what a task costs, and what a byte of its result costs on the way."""
    executor = client.get_executor(pure=False)
    count, large = (50, 2**20) if QUICK else (300, 2**23)

    def some(number: int, size: int) -> None:
        wait([executor.submit(nothing, size) for _ in range(number)])

    some(20, 1)
    message = timed(lambda: some(count, 1), 2, clock) / count

    def fetched() -> None:
        executor.submit(nothing, large).result()

    fetched()
    return message, timed(fetched, 5, clock) / large


# --- the model ------------------------------------------------------------------------------------


def chunk_size(seconds: float, samples: int, workers: int) -> int:
    """Return the chunk that the study settles on for samples of this cost."""
    chunks = Chunks()
    while True:
        before = chunks.size(samples, workers)
        chunks.learn(before, before * seconds)
        if chunks.size(samples, workers) == before:
            return before


def throughput(demands: list[float], service: float, workers: int, chunks: int) -> float:
    """Return the chunks per second of a closed network: workers, and stations that serve one at a time.

    Mean value analysis (Reiser & Lavenberg 1980), the workers as one station of many servers by Seidmann's
    approximation: a queue of service / workers, and a delay of the rest.
    """
    queues = [*demands, service / workers]
    delay = service * (workers - 1) / workers
    waiting = np.zeros(len(queues))
    rate = 0.0
    for inside in range(1, chunks + 1):
        residence = np.array(queues) * (1 + waiting)
        rate = inside / (delay + residence.sum())
        waiting = rate * residence
    return rate


def rate_of(costs: Costs, seconds: float, samples: int, workers: int) -> tuple[float, int]:
    """Return samples per second of a study, and its chunk."""
    chunk = chunk_size(seconds, samples, workers)
    client = costs.sync + chunk * costs.client
    return chunk * throughput([costs.message, client], chunk * seconds, workers, 2 * workers), chunk


# --- the check ------------------------------------------------------------------------------------


@lru_cache
def real_outcomes(path: str) -> SampleOutcomes:
    """Read outcomes once in each worker: they come back, but do not go there."""
    return unpacked(Path(path).read_bytes())


def pretend(path: str, count: int, seconds: float) -> Done:
    """Take as long as so many samples would, without work, and return outcomes."""
    outcomes = real_outcomes(path)
    time.sleep(count * seconds)
    rows = np.arange(count)
    some = SampleOutcomes(list(outcomes.picked(rows % len(outcomes), rows)), count)
    return Done(packed(some), count * seconds)


class Pretenders(StudyExecutor):
    """Threads of Dask workers that sleep instead of computing."""

    def __init__(self, client: Client, workers: int, path: Path, seconds: float) -> None:
        super().__init__()
        self.width, self.client, self.seconds = workers, client, seconds
        self.path = str(path)

    def _start(self) -> Executor:
        executor: Executor = self.client.get_executor(pure=False)
        return executor

    def submit(self, call: Callable[..., Any], *args: Any) -> Any:  # noqa: ARG002
        """Have a chunk's time pass on a worker."""
        return super().submit(pretend, self.path, len(args[1]), self.seconds)


def simulated(
    folder: Path, client: Client, workers: int, seconds: float, samples: int, outcomes: SampleOutcomes
) -> float:
    """Return the samples per second that the study's own driver and journal reach with sleeping workers."""
    study = folder / "pretend.yaml"
    study.write_text(STUDY.format(scene=HERE.parent / "configs/isolator.yaml", samples=samples))
    plan = make_plan(load_scene(study))
    keys = sample_keys(plan, range(samples))
    path = folder / f"p{workers}-{seconds}.journal"
    journal = Journal(str(path))
    marks: list[tuple[float, int]] = []

    def arrived(chunks: list[Chunk]) -> None:
        journal.append([(keys[numbers], outcomes) for numbers, outcomes in chunks])
        marks.append((time.perf_counter(), sum(len(numbers) for numbers, _ in chunks)))

    held = folder / "outcomes"
    held.write_bytes(packed(outcomes).content)
    pool = Pretenders(client, workers, held, seconds)
    Scheduler(pool, Job.of(plan.base, ()), plan, np.arange(samples), arrived).run()
    journal.close()
    path.unlink()
    # Chunks grow at the start and shrink at the end: what lies between is the steady state.
    done = np.cumsum([count for _, count in marks])
    first, last = (int(np.searchsorted(done, share * samples)) for share in (0.2, 0.8))
    return float(done[last] - done[first]) / (marks[last][0] - marks[first][0])


def as_loaded(costs: Costs, folder: Path, client: Client, outcomes: SampleOutcomes) -> Costs:
    """Return the costs by the clock, with whatever else this machine does at the moment."""
    message, byte = messages(client, time.perf_counter)
    dumped = pickle.dumps(Done(packed(outcomes), 0.0))
    code = timed(lambda: pickle.loads(dumped), 3, time.perf_counter) / len(outcomes)
    journal = Journal(str(folder / "loaded.journal"))
    keys = np.arange(2 * len(outcomes), dtype="<u8").view(np.uint8).reshape(len(outcomes), SIZE)
    one, all_of_them = packed(SampleOutcomes.of(outcomes[:1])), packed(outcomes)
    sync = timed(lambda: journal.append([(keys[:1], one)]), 5, time.perf_counter)
    appended = timed(lambda: journal.append([(keys, all_of_them)]), 2, time.perf_counter) / len(keys)
    journal.close()
    Path(journal.path).unlink()
    return replace(costs, message=message, byte=byte, code=code, sync=sync, journal=appended)


def check(folder: Path, costs: Costs, outcomes: SampleOutcomes) -> list[tuple[int, float, float, float]]:
    """Return workers, seconds a sample, and the measured and the modelled samples per second."""
    rows = []
    cases = [(w, s) for s in (0.5, 1e-2, 1e-3) for w in (1, 8, 64)][:-1]
    cases = [(2, 1e-2), (8, 1e-2)] if QUICK else cases
    for workers, seconds in cases:
        with cluster_of(workers) as cluster, Client(cluster) as client:
            samples = int(np.clip((4 if QUICK else 6) * workers / seconds, 12 * workers, 20_000))
            loaded = as_loaded(costs, folder, client, outcomes)
            found = simulated(folder, client, workers, seconds, samples, outcomes)
        rows.append((workers, seconds, found, rate_of(loaded, seconds, samples, workers)[0]))
        print(*rows[-1], flush=True)
    return rows


# --- the page -------------------------------------------------------------------------------------


def span(seconds: float) -> str:
    """Write a time as a reader wants it."""
    for unit, size in (("d", 86400.0), ("h", 3600.0), ("min", 60.0), ("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds / 1e-9:.3g} ns"


def amount(size: float) -> str:
    """Write a number of bytes."""
    for unit, one in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if size >= one:
            return f"{size / one:.3g} {unit}"
    return f"{size:.3g} B"


def table(head: list[str], rows: list[list[str]]) -> str:
    """Write a table of Markdown."""
    return "\n".join(f"| {' | '.join(row)} |" for row in [head, ["---"] * len(head), *rows])


def saturated(costs: Costs, seconds: float, workers: int, chunk: int) -> str:
    """Name what limits the rate: what takes longest for a sample when all is shared out."""
    parts = {
        "workers": seconds / workers,
        "scheduler": costs.message / chunk,
        "client": costs.client + costs.sync / chunk,
    }
    return max(parts, key=lambda name: parts[name])


def prediction(costs: Costs, kinds: dict[str, float]) -> list[list[str]]:
    """Return the rows of the table of predictions."""
    rows = []
    for kind, seconds in kinds.items():
        for size in SIZES:
            for workers in WORKERS:
                rate, chunk = rate_of(costs, seconds, min(size, MOST), workers)
                file = size * costs.file
                total = size * costs.prepare + size / rate + file
                shards = sharded(costs, seconds, workers)
                apart = size / shards * (costs.prepare + costs.client + costs.file)
                compute = size * seconds / workers
                lifted = compute + apart
                row = [
                    kind, f"{size:.0e}".replace("+0", ""), f"{workers:,}", span(compute), f"{chunk:,}",
                    span(size / chunk * costs.message), span(size * costs.client),
                    span(size * costs.prepare), span(file), span(total),
                    saturated(costs, seconds, workers, chunk), str(shards), span(lifted),
                ]  # fmt: skip
                rows.append(row)
    return rows


def sharded(costs: Costs, seconds: float, workers: int) -> int:
    """Return how many shards keep every client below a tenth of what its workers take."""
    serial = costs.prepare + costs.client + costs.file
    return int(np.clip(np.ceil(10 * serial * workers / seconds), 1, workers))


def page(costs: Costs, rows: list[tuple[int, float, float, float]]) -> str:
    """Return the page."""
    kinds = {
        f"isolator, batched ({span(costs.sample)})": costs.sample,
        "10 ms": 1e-2,
        "1 s": 1.0,
    }
    ratios = np.array([found / model for _, _, found, model in rows])
    knees = [
        f"{max(1, seconds / costs.client):,.0f} workers where one takes {span(seconds)}"
        for seconds in kinds.values()
    ]
    one = table(
        ["what", "cost"],
        [
            ["one sample of the isolator (zeros, poles, properties), among many", span(costs.sample)],
            ["plan and key of a sample, before the start", span(costs.prepare)],
            ["a task: scheduler and the client's loop, there and back", span(costs.message)],
            ["a sample's outcome, pickled and unpickled", span(costs.code)],
            ["its size on the way", amount(costs.size)],
            ["a byte from a worker to the client", span(costs.byte)],
            ["a sample into the journal", span(costs.journal)],
            ["an append to the journal, made durable, whatever is in it", span(costs.sync)],
            ["a sample from the journal's outcome into the file, statistics included", span(costs.file)],
            ["its size in the file", amount(costs.stored)],
        ],
    )
    compared = table(
        ["workers", "a sample takes", "samples/s measured", "samples/s by the model", "ratio"],
        [[str(w), span(s), f"{f:,.0f}", f"{m:,.0f}", f"{f / m:.2f}"] for w, s, f, m in rows],
    )
    predicted = table(
        [*HEADINGS],
        prediction(costs, kinds),
    )
    return PAGE.format(
        one=one,
        compared=compared,
        predicted=predicted,
        median=f"{np.median(ratios):.2f}",
        within=int(((ratios > 0.5) & (ratios < 2)).sum()),
        cases=len(ratios),
        limit=f"{1 / costs.client:,.0f}",
        client_knees=", ".join(knees),
        scheduler_knee=f"{0.5 / costs.message:,.0f}",
        tasks=f"{1 / costs.message:,.0f}",
        file=span(costs.file + costs.prepare),
        biggest=amount(SIZES[-1] * costs.stored),
        merge=span(MOST * costs.file),
        most=f"{MOST:.0e}".replace("+0", ""),
        studies=SIZES[-1] // MOST,
        cores=os.cpu_count(),
        load=f"{os.getloadavg()[2]:.0f}",
    )


PAGE = """\
# How far dynid scales

What a run costs against its size, what limits it, and what to do beyond. Times of the first three parts
are processor times on one thread of a shared two-core machine, to be read as orders of magnitude; `dynid
bench` measures them on yours. *On paper* means that nothing of this size was run.

## Structures

A factorisation decides. With nested dissection the factors of a plate of $n$ DOFs have about $n \\log n$
entries and take $n^{{1.5}}$ operations; of a solid $n^{{4/3}}$ and $n^2$. Ten modes, proved complete:

| | DOFs | by dynid | by PARDISO (`dynid[solvers]`) |
| --- | --- | --- | --- |
| plate with SEREP, whole process | 99,856 | 0.67 times a script of SciPy, 0.61 of its memory | 0.64 times |
| plate | 996,483 | 41 s, 4.3 GB | 50 s, 4.3 GB |
| block of linear hexahedra | 86,490 | 31 s, 1.4 GB | 20 s, 1.3 GB |
| plate, on paper | 1e7 | 10 to 30 min, 50 GB | |
| solid, on paper | 1e6 | | 40 min, 31 GB |

- **Memory ends first,** and it is that of the factors. Between the two plates it grew as $n^{{1.03}}$, time
  as $n^{{1.0}}$.
- **32 bits.** SuperLU, which is used without the C library and PARDISO, counts the entries of its factors
  by 32 bits; there a matrix of more than 71 million entries is refused.
- **Beyond:** reduce the parts in the FE code, import each as matrices with its boundary DOFs, and join
  them (`structures:` of an identification); on a few thousand coordinates everything else takes seconds.
  Fewer elements of higher order help solids more than a solver does.
- **Rounding** grows with refinement: see [very fine meshes](limits.md#structures-sizes).

## Bond graphs

A frequency response is a program of the junction structure, planned once. Chains of mass, spring and
damper stages (three elements and two junctions each), 1,000 frequencies, plan included, beside a
recursion written by hand for just this chain:

| stages | time | memory of the process | of the recursion |
| --- | --- | --- | --- |
| 1,000 | 0.04 s | 72 MB | 3.5 times |
| 10,000 | 0.33 s | 0.38 GB | 2.7 times |
| 30,000 (90,000 elements) | 1.1 s | 0.45 GB | 3.0 times |
| 100,000 (300,000 elements) | 3.5 s | 1.05 GB | 2.7 times |
| 1,000,000, on paper | 40 s | 10 GB | |

- **Growth.** Time, from the nodes and bonds on, grew as the number of stages to the power of 0.9 between
  1,000 and 10,000, and 1.03 from there to 100,000. On loops fill of the elimination adds to it, as of any
  sparse matrix: a ladder of two rails stays near linear, a square mesh of $n$ elements takes $n^{{1.5}}$ at
  best.
- **Whole analyses** after reading, peaks and scope included, at 100 frequencies, beside a loop over
  SuperLU that a user would write (`dynid bench mesh-response ladder-peaks chain-whole`): lattices of 20
  x 20 to 100 x 100 nodes 1.4 to 2.1 times its processor time, a ladder of 100 rungs 0.7 times, chains
  of 10,000 and 100,000 stages 1.2 and 1.7 times. Zeros and poles of a lattice of 20 x 20, each with its
  bound, take 8 times dense eigenvalues, which have none and return 370 zeros of 361 (`mesh-roots`).
- **Exact zeros and poles** cost the cube of the order and more: 400 storage elements, 80 on many loops,
  then the floating-point engine takes over, up to 8,000 ([limits](limits.md#bond-graphs-sizes)).
- **A scene** is limited to 8 MiB of text; its reading takes 2.1 to 2.7 times what PyYAML's parser in C
  needs (`dynid bench chain-reading`). Larger graphs are built in Python, of any size, in two thirds of
  that time.
- **Beyond:** what is large and linear is usually a structure: reduce it, and let it enter the graph as a
  node `structure`. Repeated parts belong into `models:` with `repeat`.

## Records

A filter pass and a prediction are linear in the samples. Of an identification the sensitivities limit
the memory ([limits](limits.md#identification)). Beyond: frequency responses in place of records.

Where the residuals are not noise, further starts are tried, one after the other. A model that explains
nothing of a record costs 0.4 s with 800 samples, 2 s with 8,000 and 7 s with 40,000 (two channels, four
parameters) until five starts agree. Starts side by side would save little: two fifths of that time are
spent in the C library, which threads can share, so that two cores save a quarter at most; processes take
half a second each to start, and studies use all cores already.

## Start-up

Processor time of whole commands, files compiled before; beside it that of a Python process that imports the
same modules (dynid's own among them), and of one that imports those of other packages alone (NumPy, h5py,
pydantic, PyYAML, click). `dynid bench startup` measures this.

| command | time | over its modules | over the packages |
|---|---|---|---|
| `dynid run configs/suspension_noisy.yaml` | 0.44 s | 1.02 | 1.8 |
| `dynid run configs/isolator.yaml` | 0.40 s | 0.87 | 1.5 |
| `dynid check suspension_noisy.yaml` | 0.32 s | 0.84 | 1.3 |
| `dynid show suspension_noisy.h5` | 0.25 s | 1.3 | 1.7 |
| `dynid --help` | 0.05 s | 0.87 | 1.2 |

Ratios below one: dynid looks for garbage less often than Python does by itself, and not at the end, where
nothing is to be found; a process of imports that does the same is exceeded 1.4 times by the first run. A
fifth of that run is the analysis and its file, a quarter the checked model of the scene (pydantic with
dynid's schema).

## Studies

Written by `python docs/scaling.py` on {cores} cores: every number of this part is measured, or follows from
measurements by the model below.

### Costs

{one}

Times are processor times (scheduler and client share a process here, so the cost of a task includes
both); only the append is wall-clock time, since it waits for the disk.

Samples are grouped into chunks of half a second, at most 4096 samples, so that scheduler and disk handle
chunks instead of samples.

### Model and validation

A study is a closed network of queues. The number of chunks in progress is twice the number of workers.
Each chunk is computed by a worker, passes the scheduler (one at a time), and then the client, which
unpickles it, appends it to the journal and makes it durable (one at a time). Mean value analysis gives
the rate.

The model was validated with workers that sleep for the duration of a sample and return real outcomes,
with the study's own driver, its journal and a real Dask scheduler, up to the limits of this machine. For
the validation the costs are wall-clock times, measured in the same cluster right before each run, with
whatever else the machine did at that moment (load {load} on {cores} cores); the start and the end of a
run, where chunks grow and shrink, do not count:

{compared}

The median of the ratios is {median}, and {within} of {cases} are within a factor of two.

### Where 1e6 and 1e8 samples spend their time

Times are for the whole study. Computing is shared by the workers and concurrent with scheduler and
client; keys are computed before, the file is written after. *In one piece* is the total time of the
study.

{predicted}

- The **scheduler** serves {tasks} tasks a second. Chunks of half a second saturate it from
  {scheduler_knee} workers on, for any duration of a sample.
- The **client** handles {limit} samples a second for any number of workers: it saturates from
  {client_knees}.
- The **file** is written last: the client computes keys and file, {file} per sample, sequentially.
- 1e8 samples need {biggest} and exceed the limit of one study ({most}); {studies} studies with different
  seeds are equivalent.

### Sharded studies

With `--shard I/N` every part has its own client, journal and file, so all of them scale with N. No
scheduler is needed, because each shard runs on the cores of its node. The column *shards* is the number
that keeps the client below a tenth of its workers' time; the last column is the total time with these
shards. `dynid study-merge` is one process, {merge} for {most} samples; separate files can be read
together, as they have the same arrays.

```sh
# a job array of 100 jobs (Slurm); a job that was killed goes on when it is started again
dynid study study.yaml --shard $SLURM_ARRAY_TASK_ID/100 --executor processes
dynid study-merge study-*-of-100.h5 -o study.h5
```
"""

GRAPHS = """
## Large graphs

Processor time of graphs from the nodes and bonds on, and of their frequency response at 1,000
frequencies. An element is an I, C or R. The exponent is the slope of the time against the size, both in
logarithms; that of the response of a ladder includes the second plan, which keeps error bounds small.

{graphs}
"""


def graphs() -> str:
    """Return the table of large graphs."""
    from dynid.bench.cases import chain, frequency_response
    from dynid.bondgraph.graph import BondGraph
    from dynid.bondgraph.graph_response import frequency_response as response
    from dynid.bondgraph.reduced_graph import ReducedGraph

    sizes = (1000, 3000, 10_000, 30_000, 100_000)
    models = {
        "chain": (chain.reduced, 3),
        "random tree": (frequency_response.tree, 2),
        "ladder": (frequency_response.ladder, 8),
    }
    rows = []
    for name, (model, elements) in models.items():
        plans, responses = [], []
        for size in sizes:
            planned = model(size // elements)
            nodes, bonds = list(planned.graph.nodes.values()), planned.graph.bonds
            asked = planned.inputs, planned.outputs
            plans.append(
                timed(
                    lambda n=nodes, b=bonds, a=asked: ReducedGraph(BondGraph(n, b), *a, traced=False),
                    repeat=3,
                )
            )
            responses.append(timed(lambda p=planned: response(p, frequency_response.frequencies()), repeat=2))
        for what, times in (("plan", plans), ("response", responses)):
            exponent = np.polyfit(np.log(sizes), np.log(times), 1)[0]
            rows.append([f"{name}, {what}", *map(span, times), f"{exponent:.2f}"])
    return table(["graph", *(f"{size:,} elements" for size in sizes), "exponent"], rows)


def main() -> None:
    """Measure, check, write; the page goes to the file named last, if any."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with cluster_of(1) as cluster, Client(cluster) as client:
            costs, outcomes = measure(folder, client)
        print(costs, flush=True)
        text = page(costs, check(folder, costs, outcomes)) + GRAPHS.format(graphs=graphs())
    target = Path(sys.argv[-1]) if sys.argv[-1].endswith(".md") else HERE / "scaling.md"
    target.write_text(text)


if __name__ == "__main__":
    main()
