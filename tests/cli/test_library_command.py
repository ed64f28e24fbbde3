"""`dynid library`."""

from click.testing import CliRunner

from dynid.cli import cli
from dynid.scene.models import library_names, library_text


def library(*arguments):
    return CliRunner().invoke(cli, ["library", *arguments])


def test_the_models_are_listed_with_their_ports():
    answer = library()
    lines = answer.output.splitlines()
    assert [line.split()[0] for line in lines] == library_names()
    assert lines[0].endswith("ports supply, shaft")


def test_a_model_is_printed_as_its_file():
    assert library("gear").output == library_text("gear")


def test_an_unknown_model_is_refused_with_the_nearest():
    answer = library("geer")
    assert answer.exit_code != 0
    assert "no model 'geer'; did you mean 'gear'?" in str(answer.output) + str(answer.exception)
