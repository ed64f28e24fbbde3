"""Files of studies that an earlier build has written are read and resumed."""

import shutil
from pathlib import Path

from dynid.store import read_result
from dynid.study.executors import SerialExecutor
from dynid.study.run import run_study
from tests.study.small import assert_same, planned

STORED = Path(__file__).parents[1] / "data" / "study"


def test_a_finished_file_is_recognised(tmp_path):
    shutil.copy(STORED / "masses.h5", tmp_path)
    progress = run_study(planned(tmp_path), tmp_path / "masses.h5", SerialExecutor())
    assert (progress.kept, progress.finished) == (12, 12)
    assert read_result(tmp_path / "masses.h5")["study/status"].data.tolist() == ["done"] * 12


def test_the_journal_of_an_interrupted_study_is_resumed(tmp_path):
    shutil.copy(STORED / "masses.h5.journal", tmp_path)
    assert run_study(planned(tmp_path), tmp_path / "masses.h5", SerialExecutor()).kept == 12
    assert_same(tmp_path / "masses.h5", STORED / "masses.h5")
