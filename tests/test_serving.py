"""A run that is followed in a browser: who may ask, what is answered, and what the page does when the run goes on."""

import http.client
import json
import re
import signal
import socket
import subprocess
from urllib.parse import urlsplit

import commands
import pytest
from browsing import serving

import auroraqd
from auroraqd.report.explorer import serving as explorer_serving
from auroraqd.report.explorer.serving import Followed
from auroraqd.runs import folders

TASK = auroraqd.tasks.Ballistic()
PINNED = "return explorer.state.pins.map(({ skill }) => explorer.data().runs[0].id[skill])"
READING = "return document.getElementById('live').firstElementChild.textContent"


def begun():
    return auroraqd.Aurora(2, "hand-coded", seed=0, batch_size=50)


def further(aurora, folder, generations=1):
    auroraqd.save(aurora.run(TASK, generations=generations), folder)
    return aurora


@pytest.fixture
def folder(tmp_path):
    return auroraqd.save(begun().run(TASK, generations=4), tmp_path / "run")


@pytest.fixture
def served(folder):
    with serving(folder) as server:
        yield server


def asked(server, path, *, method="GET", token=None, **headers):
    """Status, headers and text of an answer."""
    connection = http.client.HTTPConnection("127.0.0.1", server.server_address[1], timeout=60)
    joint = "&" if "?" in path else "?"
    try:
        connection.request(method, f"{path}{joint}token={server.token if token is None else token}", headers=headers)
        answer = connection.getresponse()
        return answer.status, answer.headers, answer.read().decode()
    finally:
        connection.close()


def state(server):
    return json.loads(asked(server, "/state")[2])


def test_the_page_is_that_of_the_run(served, folder):
    status, headers, page = asked(served, "/")
    assert status == 200
    assert headers["Content-Type"] == "text/html; charset=utf-8"
    assert "application/json" in page
    assert f"<title>{folder.name}</title>" in page
    assert asked(served, "/", method="HEAD")[2] == ""
    assert asked(served, "/other")[0] == 404
    assert asked(served, "/", method="POST")[0] == 501


@pytest.mark.parametrize("path", ["/", "/state", "/film?id=0", "/other"])
@pytest.mark.parametrize("token", ["", "wrong", "%C3%A9", "%FF"])
def test_without_the_token_nothing_is_said(served, path, token):
    status, headers, said = asked(served, path, token=token)
    assert status == 403
    assert said == "the address must be the one that `auroraqd explore --serve` printed"
    assert "script-src 'none'" in headers["Content-Security-Policy"]


@pytest.mark.parametrize("host", ["evil.example", "evil.example:80", "127.0.0.1.evil.example", "", "[::1]", "localhost."])
def test_a_page_of_another_name_that_leads_here_is_refused(served, host):
    assert asked(served, "/", Host=host)[0] == 403


def test_an_address_that_is_none(served):
    with socket.create_connection(served.server_address[:2], timeout=60) as connection:
        connection.sendall(b"GET http://[/ HTTP/1.0\r\n\r\n")
        assert b" 400 " in connection.recv(100)


@pytest.mark.parametrize("host", ["localhost", "localhost:9999", "127.0.0.1"])
def test_a_tunnel_may_have_another_port(served, host):
    assert asked(served, "/state", Host=host)[0] == 200


def test_only_scripts_of_the_page_run(served):
    _, headers, page = asked(served, "/")
    policy = headers["Content-Security-Policy"]
    (nonce,) = re.findall(r"script-src 'nonce-([\w-]+)' 'unsafe-eval';", policy)
    scripts = re.findall(r"<script([^>]*)>", page)
    assert len(scripts) >= 4
    assert all(f'nonce="{nonce}"' in script for script in scripts)
    for rule in ("default-src 'none'", "connect-src 'self'", "base-uri 'none'", "form-action 'none'", "frame-ancestors 'none'"):
        assert rule in policy
    assert headers["Referrer-Policy"] == "no-referrer"
    assert headers["Cache-Control"] == "no-store"
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert "Access-Control-Allow-Origin" not in headers


def test_only_this_machine_is_answered(served):
    assert served.server_address[0] == "127.0.0.1"
    others = {each[4][0] for each in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)} - {"127.0.0.1"}
    for address in others:
        with pytest.raises(OSError):
            socket.create_connection((address, served.server_address[1]), timeout=5).close()


def test_what_is_no_request_ends_nothing(served):
    for said in (
        b"",
        b"\0" * 100,
        b"GET / HTTP/1.0\r\nHost: \xff\r\n\r\n",
        b"GET /%ff?token=%ff HTTP/9.9\r\n\r\n",
        b"GET " + b"a" * 70_000,
    ):
        with socket.create_connection(served.server_address, timeout=60) as connection:
            connection.sendall(said)
            connection.shutdown(socket.SHUT_WR)
            while connection.recv(65536):
                pass
    assert state(served)["trouble"] == ""


def test_a_new_checkpoint_is_shown(folder, served):
    aurora = auroraqd.resume(folder)
    before, page = state(served), asked(served, "/")[2]
    assert asked(served, "/")[2] == page  # as there is no other
    further(aurora, folder)
    now = state(served)
    assert now["checkpoint"] != before["checkpoint"]
    assert now["of"] == f"generation 5, {len(aurora.archive):,} skills"
    assert f'data-checkpoint="{now["checkpoint"]}"' in asked(served, "/")[2]


def test_the_last_good_checkpoint_stays(folder, served):
    page, good = asked(served, "/")[2], state(served)
    whole = (folder / folders.REPERTOIRE).read_bytes()
    (folder / folders.REPERTOIRE).write_bytes(whole[:1000])
    assert state(served)["checkpoint"] != good["checkpoint"]  # nobody has tried to read it
    assert asked(served, "/")[2] == page
    assert "is damaged" in state(served)["trouble"]
    assert state(served)["checkpoint"] == good["checkpoint"]
    (folder / folders.REPERTOIRE).unlink()
    assert asked(served, "/")[2] == page
    (folder / folders.REPERTOIRE).write_bytes(whole)
    assert asked(served, "/")[2] != page
    assert state(served)["trouble"] == ""
    (folder / folders.PREVIOUS).write_bytes(whole)
    (folder / folders.REPERTOIRE).write_bytes(b"half")
    assert asked(served, "/")[0] == 200
    assert state(served)["trouble"] == ""  # there is the one before


def test_before_the_first_checkpoint_the_page_waits(tmp_path):
    (tmp_path / folders.CONFIG).write_text("{}")
    followed = Followed(tmp_path, 1000)
    assert "has no skill yet" in followed.page()[0]
    assert followed.state() == {"checkpoint": "", "of": "", "trouble": ""}
    auroraqd.save(begun(), tmp_path)
    assert "has no skill yet" in followed.page()[0]
    further(begun(), tmp_path)
    assert "data-checkpoint" in followed.page()[0]


def test_what_is_no_robot_has_no_film(served):
    asked(served, "/")
    id = int(served.followed._source.repertoire.id[0])
    said = json.loads(asked(served, f"/film?id={id}")[2])
    assert said == {
        "trouble": "the task of the run is no robot that MuJoCo draws, or cannot be imported here: name it with task"
    }
    assert "is not stored" in json.loads(asked(served, "/film?id=123456")[2])["trouble"]
    for query, came in (("?id=x", "'x'"), ("", "''")):
        trouble = json.loads(asked(served, f"/film{query}")[2])["trouble"]
        assert trouble == f"id must be that of a skill, a whole number, got {came}"


def test_a_robot_that_raises_is_said(served, monkeypatch):
    def broken(*_):
        raise RuntimeError("the arm fell off")

    asked(served, "/")
    monkeypatch.setattr(explorer_serving, "filmed", broken)
    id = int(served.followed._source.repertoire.id[0])
    assert json.loads(asked(served, f"/film?id={id}")[2]) == {"trouble": "RuntimeError: the arm fell off"}


def test_what_cannot_be_served_is_said(folder, tmp_path):
    def said(*arguments):
        done = commands.cli("explore", "--serve", *arguments)
        assert done.returncode == 1
        assert "Traceback" not in done.stderr
        return done.stderr

    assert "there is no folder" in said(tmp_path / "none")
    (tmp_path / "other").mkdir()
    assert "no run" in said(tmp_path / "other")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert f"port {port} cannot be used: another program listens on it" in said(folder, "--port", port)
    assert "--serve shows one run folder" in said(folder, folder)
    assert "leave out --out and --films" in said(folder, "--out", tmp_path / "x.html")
    assert "leave out --out and --films" in said(folder, "--films", 2)
    assert "port" in commands.cli("explore", "--serve", folder, "--port", 70_000).stderr


def test_the_command_serves_until_control_c(folder):
    line = [*commands.CLI, "explore", "--serve", folder]
    with subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            address = urlsplit(process.stdout.readline().strip())
            connection = http.client.HTTPConnection(address.netloc, timeout=60)
            connection.request("GET", f"/state?{address.query}")
            assert json.load(connection.getresponse())["of"].startswith("generation 4, ")
            connection.close()
            process.send_signal(signal.SIGINT)
            said, errors = process.communicate(timeout=60)
        finally:
            process.kill()
    assert process.returncode == 0, errors
    assert errors == ""
    assert said.splitlines()[-1] == f"{folder} is no longer served"
    assert address.query not in said


def newest(browser):
    """Press the button that shows a new checkpoint, once there is one, and wait until it is there."""
    browser.until("return !document.querySelector('#live button').hidden")
    before = browser.js("return document.getElementById('live').dataset.checkpoint")
    browser.js("document.querySelector('#live button').click()")
    there = f"document.getElementById('live')?.dataset.checkpoint !== '{before}'"
    browser.until(f"return document.documentElement.dataset.ready && {there}")


def test_the_page_goes_on_with_the_run_and_keeps_what_was_pinned(folder, served, browser, monkeypatch):
    aurora = auroraqd.resume(folder)
    browser.open(served.url)
    browser.until(READING)
    assert browser.text("live").startswith("This is the last checkpoint.")
    stays, goes = aurora.archive.id[[-1, 2]]
    for row in (-1, 2):
        browser.click(browser.place(0, *map(float, aurora.archive.descriptor[row])))
        browser.rest()
    browser.js(
        "const s = document.getElementById('colour'); s.value = [...s.options].findIndex((o) => o.text === 'novelty');"
        "s.dispatchEvent(new Event('change'));"
    )
    assert browser.js(PINNED) == [stays, goes]
    further(aurora, folder, generations=2)
    loaded = folders.load(folder)
    columns = {name: rows[loaded.id != goes] for name, rows in loaded.columns.items()}
    monkeypatch.setattr(folders, "load", lambda _: auroraqd.Repertoire(columns, loaded._origin))
    newest(browser)
    assert browser.js(PINNED) == [stays]
    assert browser.text("said") == "1 of the skills that were pinned is not stored any more."
    assert browser.js("return document.getElementById('colour').selectedOptions[0].text") == "novelty"
    assert [each for each in browser.troubles() if not each.startswith(served.url.partition("?")[0])] == []


def test_each_new_checkpoint_is_shown_if_that_is_wanted(folder, served, browser):
    browser.open(served.url)
    browser.js("document.querySelector('#live input').click()")
    aurora = further(auroraqd.resume(folder), folder)
    browser.until(f"return window.explorer?.data()?.runs[0].total === {len(aurora.archive)}")
    browser.until("return document.querySelector('#live input').checked")


def test_the_page_says_when_the_server_has_ended(folder, browser):
    with serving(folder) as server:
        browser.open(server.url)
        browser.until(READING)
    browser.until(f"{READING} === 'The server does not answer. This is what it showed last.'")
    browser.js("explorer.move('map0', {x: 0, y: 0})")
    browser.driver.get("about:blank")


def test_a_run_that_goes_on_beside_it(tmp_path, browser):
    """Each page, whenever it is asked for, is a whole one, and each new one has no fewer generations."""
    line = [
        *commands.CLI,
        "run",
        "ballistic",
        "--descriptor",
        "pca",
        "--generations",
        "4000",
        "--checkpoint-every",
        "0",
        "--no-figures",
    ]
    with subprocess.Popen([*line, "--out", tmp_path / "run"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            while not (tmp_path / "run" / folders.REPERTOIRE).exists():
                assert process.poll() is None
            with serving(tmp_path / "run") as server:
                browser.open(server.url)
                seen = [browser.js("return explorer.data().runs[0].total")]
                for _ in range(3):
                    newest(browser)
                    seen.append(browser.js("return explorer.data().runs[0].total"))
                browser.driver.get("about:blank")
            assert process.poll() is None
            assert len(set(seen)) > 1
        finally:
            process.kill()
    assert min(seen) > 0
