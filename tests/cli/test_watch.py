"""`dynid watch`: a page that follows its scene, served to this machine and nobody else."""

import http.client
import json
import signal
import subprocess
import sys
import threading
import time

import pytest

from dynid.cli.watch import Board, Notice, Watch, files_of, serving, stamp
from dynid.errors import UsageError
from dynid.store import read_result as open_result

pytestmark = pytest.mark.thorough


def ask(server, path="/", method="GET", token=None, **headers):
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=600)
    connection.request(method, f"/{server.token if token is None else token}{path}", headers=headers)
    answer = connection.getresponse()
    return answer, connection


@pytest.fixture
def server():
    with serving(0) as running:
        running.board.put(page="<p>one</p>", version=1)
        yield running


def test_the_page_is_served_with_headers_that_keep_it_to_itself(server):
    answer, _ = ask(server)
    assert (answer.status, answer.read()) == (200, b"<p>one</p>")
    assert answer.getheader("Content-Type") == "text/html; charset=utf-8"
    assert answer.getheader("X-Content-Type-Options") == "nosniff"
    assert answer.getheader("X-Frame-Options") == "DENY"
    assert answer.getheader("Cache-Control") == "no-store"
    assert server.server_address[0] == "127.0.0.1"


@pytest.mark.parametrize("path", ["/favicon.ico", "/..", "/small.yaml", "//etc/passwd", "/?x", "/events/"])
def test_nothing_but_the_page_is_served(server, path):
    assert ask(server, path)[0].status == 404


@pytest.mark.parametrize(
    "headers", [{"Host": "evil.example"}, {"Host": "evil.example:80"}, {"Origin": "http://evil.example"}]
)
@pytest.mark.parametrize("path", ["/", "/events"])
def test_other_names_and_origins_are_refused(server, path, headers):
    assert ask(server, path, **headers)[0].status == 403


@pytest.mark.parametrize("token", ["", "x", "..", "AAAAAAAAAAAAAAAAAAAAAA"])
@pytest.mark.parametrize("path", ["/", "/events", ""])
def test_without_the_token_nothing_is_served(server, token, path):
    answer, _ = ask(server, path, token=token)
    assert (answer.status, answer.read()) == (403, b"")


def test_each_server_has_a_token_of_its_own(server):
    with serving(0) as other:
        assert server.token != other.token
        assert len(other.token) >= 20
        assert other.address.endswith(f":{other.server_port}/{other.token}/")
        assert ask(other, token=server.token)[0].status == 403


def test_the_number_of_connections_is_limited(server):
    open_streams = [ask(server, "/events") for _ in range(16)]
    assert all(answer.status == 200 for answer, _ in open_streams)
    assert ask(server)[0].status == 503
    for answer, connection in open_streams:
        answer.close()
        connection.close()
    for k in range(100):  # the server sees a closed stream when it writes
        server.board.put(version=k)
        answer, _ = ask(server)
        if answer.status == 200:
            break
        time.sleep(0.05)
    assert answer.read() == b"<p>one</p>"


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS"])
def test_nothing_but_reading_is_answered(server, method):
    assert ask(server, method=method)[0].status == 501


def test_events_say_what_is_and_then_what_changes(server):
    answer, connection = ask(server, "/events", Host=f"localhost:{server.server_port}")
    assert answer.getheader("Content-Type") == "text/event-stream"

    def event():
        line = answer.readline()
        assert answer.readline() == b"\n"
        return json.loads(line.removeprefix(b"data: "))

    assert event() == {"version": 1, "fault": "", "running": False}
    server.board.put(fault="small.yaml:3:1: odd", running=True)
    assert event() == {"version": 1, "fault": "small.yaml:3:1: odd", "running": True}
    connection.close()


def test_a_port_that_is_taken_is_said(server):
    with pytest.raises(UsageError, match="cannot be used"), serving(server.server_port):
        pass


def test_who_waits_is_told_of_a_change_and_not_kept_for_ever():
    board = Board()
    seen = board.now
    assert board.wait(seen, 0.01) is seen
    threading.Timer(0.05, board.put, kwargs={"version": 2}).start()
    assert board.wait(seen, 600).version == 2
    assert board.wait(Notice(), 600) is board.now


def test_files_that_a_scene_reads_are_watched_and_those_of_its_scene(tmp_path):
    (tmp_path / "data").mkdir()
    (tmp_path / "data/record.csv").write_text("1\n")
    (tmp_path / "base.yaml").write_text(
        "measurement: {file: {path: data/record.csv, channel: nothing.csv}}\n"
    )
    (tmp_path / "study.yaml").write_text("kind: study\nscene: base.yaml\nother: study.yaml\n")
    names = [str(file.relative_to(tmp_path)) for file in files_of(str(tmp_path / "study.yaml"))]
    assert names == ["study.yaml", "base.yaml", "data/record.csv"]
    (tmp_path / "study.yaml").write_text("kind: [\n")
    assert len(files_of(str(tmp_path / "study.yaml"))) == 1  # a scene with faults is watched itself
    before = stamp([tmp_path / "base.yaml", tmp_path / "gone"])
    (tmp_path / "base.yaml").write_text("other\n")
    (tmp_path / "gone").write_text("here\n")
    assert all(
        a != b for a, b in zip(before, stamp([tmp_path / "base.yaml", tmp_path / "gone"]), strict=True)
    )


def test_faults_are_shown_and_the_last_good_page_stays(folder, capsys):
    board = Board()
    watch = Watch("small.yaml", (), None, board)
    watch.show()
    good = board.now
    assert (good.version, good.fault) == (1, "")
    assert "A mass on a damper" in good.page
    assert 'data-version="1"' in good.page
    assert "connect-src &#x27;self&#x27;" in good.page or "connect-src 'self'" in good.page
    text = (folder / "small.yaml").read_text()
    (folder / "small.yaml").write_text(text.replace("type: R", "type: RR"))
    watch.show()
    assert board.now.page == good.page
    assert board.now.fault.startswith("small.yaml:6:")
    assert "unknown node type" in board.now.fault or "RR" in board.now.fault
    (folder / "small.yaml").unlink()
    watch.show()
    assert "no such file" in board.now.fault
    (folder / "small.yaml").write_text(text.replace("title: A mass", "title: The mass"))
    watch.show()
    assert (board.now.version, board.now.fault) == (2, "")
    assert "The mass on a damper" in board.now.page
    assert "done in" in capsys.readouterr().err


STUDY = """
dynid: 1
kind: study
scene: small.yaml
vary: {parameters.m: {start: 1, stop: 2, points: POINTS}}
collect: [bond_graph/properties/m.f/F/dc_gain, bond_graph/transfer_function/m.f/F/poles]
"""


@pytest.mark.parametrize(("points", "looks", "said"), [(5, 1, ""), (40, 2, ""), (100_000, 2, "of 100,000")])
def test_of_a_study_so_many_samples_are_shown_as_a_short_wait_allows(
    folder, points, looks, said, monkeypatch
):
    monkeypatch.setattr("dynid.cli.watch.SECONDS", 60.0)  # however slow the machine is
    monkeypatch.setattr("dynid.cli.watch.MOST", 50)
    (folder / "study.yaml").write_text(STUDY.replace("POINTS", str(points)))
    board = Board()
    Watch("study.yaml", (), "live.h5", board).show()
    assert (board.now.fault, board.now.version) == ("", looks)
    assert said in board.now.page
    assert ("Preview" in board.now.page) == bool(said)
    assert 'id="figure-course"' in board.now.page
    shown = open_result(folder / "live.h5")["study/samples/parameters.m"].data
    assert len(shown) == min(points, 50)
    assert (shown.min(), shown.max()) == pytest.approx((1, 2), abs=0.03)  # evenly over the plan
    (folder / "study.yaml").write_text(STUDY.replace("POINTS", "-1"))
    Watch("study.yaml", (), None, board).show()
    assert "study.yaml:5:" in board.now.fault


@pytest.mark.usefixtures("folder")
def test_before_a_first_result_the_page_says_so():
    board = Board()
    Watch("small.yaml", (), None, board)
    assert "waiting for a first result" in board.now.page


def test_the_result_is_written_where_it_is_wanted(folder):
    Watch("small.yaml", ("parameters.m=3",), "live.h5", Board()).show()
    assert (folder / "live.h5").is_file()


@pytest.mark.parametrize(
    ("args", "code", "message"),
    [
        (["none.yaml"], 4, "none.yaml: no such file"),
        (["small.yaml", "-o", "small.yaml"], 2, "would overwrite the scene"),
        (["small.yaml", "--port", "70000"], 2, "70000"),
    ],
)
@pytest.mark.usefixtures("folder")
def test_what_makes_no_sense_is_refused(dynid, args, code, message):
    found, _, err = dynid("watch", "--no-browser", *args)
    assert found == code
    assert message in err


def test_a_saved_scene_is_run_again_and_ctrl_c_ends_it(folder):
    command = [sys.executable, "-m", "dynid", "watch", "small.yaml", "--no-browser"]
    watch = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, cwd=folder)
    killer = threading.Timer(600, watch.kill)
    killer.start()
    try:
        assert "at http://127.0.0.1:" in watch.stderr.readline()
        assert "done in" in watch.stderr.readline()
        text = (folder / "small.yaml").read_text()
        (folder / "new.yaml").write_text(text.replace("value: m", "value: mm"))
        (folder / "new.yaml").replace(folder / "small.yaml")  # at once: half a file has other faults
        assert "small.yaml:6:" in watch.stderr.readline()
        (folder / "small.yaml").replace(folder / "old.yaml")  # as editors save: a new file in its place
        (folder / "small.yaml").write_text(text)
        lines = [watch.stderr.readline()]
        while "done in" not in lines[-1]:
            lines.append(watch.stderr.readline())
        watch.send_signal(signal.SIGINT)
        assert watch.wait(600) == 130
        assert "Traceback" not in watch.stderr.read()
    finally:
        killer.cancel()
        watch.kill()
        watch.stderr.close()


def test_scenes_that_name_each_other_too_deep_are_followed_no_further(tmp_path):
    for k in range(8):
        (tmp_path / f"s{k}.yaml").write_text(f"scene: s{k + 1}.yaml\nback: s{max(k - 1, 0)}.yaml\n")
    found = files_of(str(tmp_path / "s0.yaml"))
    assert [file.name for file in found] == [f"s{k}.yaml" for k in range(5)]


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (MemoryError(), "small.yaml: this needs more memory than there is"),
        (KeyError("pole"), "small.yaml: a fault of dynid itself: KeyError 'pole'"),
    ],
)
@pytest.mark.usefixtures("folder")
def test_whatever_happens_in_a_run_the_watch_goes_on(monkeypatch, error, said):
    board = Board()
    watch = Watch("small.yaml", (), None, board)

    def fails(*_, **__):
        raise error

    with monkeypatch.context() as patch:
        patch.setattr("dynid.cli.run.compute", fails)
        watch.show()
    assert board.now.fault == said
    watch.show()
    assert (board.now.fault, board.now.version) == ("", 1)


@pytest.mark.usefixtures("folder")
def test_the_browser_is_opened_at_the_page_unless_none_is_wanted(dynid, monkeypatch):
    opened = []
    monkeypatch.setattr("click.launch", opened.append)
    monkeypatch.setattr(Watch, "run", lambda _: None)
    code, _, err = dynid("watch", "small.yaml")
    assert code == 0
    assert f"watching small.yaml at {opened[0]} (Ctrl-C ends)" in err
    assert dynid("watch", "small.yaml", "--no-browser")[0] == 0
    assert len(opened) == 1
