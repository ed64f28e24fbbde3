import pytest

from dynid.cli import main


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty current folder with one small scene."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.yaml").write_text(SMALL)
    return tmp_path


@pytest.fixture
def dynid(capsys):
    """Call the command line in this process: exit code, standard output, standard error."""

    def call(*args):
        capsys.readouterr()
        with pytest.raises(SystemExit) as left:
            main([str(arg) for arg in args])
        said = capsys.readouterr()
        assert "Traceback" not in said.out + said.err
        return left.value.code, said.out, said.err

    return call


SMALL = """\
dynid: 1
kind: bond-graph
title: A mass on a damper
parameters: {m: 2}
graph:
  nodes: {F: Se, m: {type: I, value: m}, b: {type: R, value: 1}, one: 1}
  bonds: [F -> one -> m, one -> b]
analysis:
  inputs: [F]
  outputs: [m.f]
  frequency: {start: 1, stop: 10, points: 5}
  time: {stop: 1, step: 0.1}
expect:
  - {path: bond_graph/properties/m.f/F/dc_gain, value: 1}
"""
