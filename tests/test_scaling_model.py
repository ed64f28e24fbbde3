"""The queue model of docs/scaling.py against closed forms, and the script as a whole."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[1] / "docs/scaling.py"


@pytest.fixture(scope="module")
def scaling():
    spec = importlib.util.spec_from_file_location("scaling", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    sys.modules["scaling"] = module  # its dataclass looks itself up
    spec.loader.exec_module(module)
    return module


def test_without_queues_workers_are_all_busy(scaling):
    assert scaling.throughput([], 2.0, 1, 5) == pytest.approx(0.5)
    # twenty chunks for ten workers: Seidmann's approximation is a little below the ten that can be
    assert scaling.throughput([0.0], 1.0, 10, 20) == pytest.approx(10, rel=0.15)


def test_a_chunk_alone_waits_for_nobody(scaling):
    assert scaling.throughput([0.1, 0.4], 2.0, 4, 1) == pytest.approx(1 / 2.5)


def test_two_equal_stations_are_those_of_the_textbook(scaling):
    # balanced closed network of M stations and N customers: N / (N + M - 1) of the service rate
    for inside in (1, 2, 5, 20):
        assert scaling.throughput([1.0], 1.0, 1, inside) == pytest.approx(inside / (inside + 1))


def test_the_slowest_station_limits_the_rate(scaling):
    assert scaling.throughput([0.01, 0.05], 0.1, 1000, 2000) == pytest.approx(20, rel=1e-6)


def test_chunks_are_half_a_second_and_no_more_than_there_is(scaling):
    assert scaling.chunk_size(1e-3, 10**7, 10) == 500
    assert scaling.chunk_size(1e-9, 10**7, 10) == 4096
    assert scaling.chunk_size(3.0, 10**7, 10) == 1
    assert scaling.chunk_size(1e-3, 200, 10) == 10


@pytest.mark.slow
def test_the_page_is_made_of_what_is_measured(tmp_path):
    page = tmp_path / "page.md"
    subprocess.run([sys.executable, SCRIPT, "--quick", page], check=True, timeout=500, capture_output=True)
    text = page.read_text()
    assert text.startswith("# How far dynid scales")
    assert not re.search(r"\{[a-z_]+\}", text)  # every placeholder is filled; exponents have braces too
    assert text.count("| 1e8 |") == 6
