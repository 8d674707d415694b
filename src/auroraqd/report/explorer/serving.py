"""A run that is followed in a browser: a server of its explorer, for this machine only.

It listens on the loopback address alone. Other pages in the same browser reach that too, so each request must have a token,
which is in the address that is printed and nowhere else; and must name this machine as its host, which a page of another name
that was made to lead here (DNS rebinding) does not.

It reads the run folder and changes nothing; the task of the run is imported when a film is asked for, and not before. While the
run writes, or if it left damaged files, the page is the last good one.
"""

import errno
import json
import os
import secrets
import sys
import threading
import warnings
from functools import partial
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from pathlib import Path
from socketserver import ThreadingTCPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

import numpy as np

from auroraqd._checks import shown
from auroraqd._files import told
from auroraqd.report.explorer.films import filmed
from auroraqd.report.explorer.page import check_bokeh, check_skills, policy, written
from auroraqd.report.explorer.runs import Source, source_of
from auroraqd.runs import folders
from auroraqd.tasks import Gym, Hexapod

_LOOPBACK = "127.0.0.1"
_HOSTS = {_LOOPBACK, "localhost"}
_PATIENCE = 60.0  # seconds that a browser may take to ask
_KEPT = 64  # films
_WAITING = """<!DOCTYPE html><html lang="en"><meta charset="utf-8"><meta http-equiv="refresh" content="2">
<meta name="viewport" content="width=device-width, initial-scale=1"><title>No skill yet</title>
<p>The run has no skill yet. This page shows the first ones when they are there."""


class Followed:
    """A run that is under way, as its last good checkpoint has it.

    Args:
        folder: of the run.
        most: skills in the page.
        task: the robot that is filmed; None: that of the run.
    """

    def __init__(self, folder: Path, most: int, task: Gym | Hexapod | None = None) -> None:
        check_bokeh()
        folders.load_config(folder)  # or it is no run folder
        self._folder, self._most, self._task = folder, most, task
        self._building, self._filming = threading.Lock(), threading.Lock()
        self._seen = self._shown = ""  # which checkpoint was looked at last; which one is in the page
        self._page, self._nonce, self._trouble = "", "", ""
        self._source: Source | None = None
        self._films: dict[int, dict[str, Any]] = {}

    def page(self) -> tuple[str, str]:
        """HTML of what there is now, and the nonce of its scripts; before the first checkpoint, a page that waits for it."""
        with self._building:
            there = self._there()
            if there != self._seen:
                self._build(there)
            return (self._page, self._nonce) if self._page else (_WAITING, secrets.token_urlsafe())

    def _build(self, there: str) -> None:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # that the checkpoint before the last is taken
                source, nonce = source_of(self._folder), secrets.token_urlsafe()
                check_skills([source])
                page = written([source], self._most, nonce=nonce, live=there)
        except (OSError, ValueError) as error:
            self._trouble = str(error) if self._page else ""
        else:
            self._page, self._nonce, self._trouble = page, nonce, ""
            self._source, self._shown, self._films = source, there, {}
        self._seen = there

    def _there(self) -> str:
        """Which checkpoint is in the folder: another one has another time, or size."""
        try:
            status = (self._folder / folders.REPERTOIRE).stat()
        except OSError:
            return ""
        return f"{status.st_mtime_ns}-{status.st_size}"

    def state(self) -> dict[str, str]:
        """Which checkpoint there is now, what it is of in words, and what is wrong with it, if it could not be read."""
        there = self._there()
        if there == self._seen and self._trouble:
            return {"checkpoint": self._shown, "of": "", "trouble": self._trouble}
        try:
            last = folders.load_history(self._folder)[-1]
            of = f"generation {last.generation:,}, {last.size:,} skills"
        except (OSError, ValueError, IndexError):  # it is being written, for instance
            of = ""
        return {"checkpoint": there, "of": of, "trouble": ""}

    def film(self, id: int) -> dict[str, Any]:
        """That of a skill, as `auroraqd.report.explorer.films` has it.

        Raises:
            ValueError: there is no such skill, or it cannot be filmed.
        """
        with self._filming:
            source, films = self._source, self._films
            if source is None:
                raise ValueError("no skill is stored yet")
            rows = np.flatnonzero(source.repertoire.id == id)
            if not len(rows):
                raise ValueError(f"the skill of id {id} is not stored any more")
            if id not in films:
                if len(films) == _KEPT:
                    films.pop(next(iter(films)))
                drawn = filmed(source.repertoire, rows, self._task)
                if not drawn:
                    raise ValueError(f"the skill of id {id} is not valid when it is done again")
                (films[id],) = drawn.values()
            return films[id]


class Server(ThreadingTCPServer):
    """It serves a run until it is closed.

    Args:
        folder: of the run.
        port: or 0, any that is free.
        most: skills in the page.
        task: the robot that is filmed; None: that of the run.

    Attributes:
        url: for the browser.

    Raises:
        FileNotFoundError, ValueError: there is no run folder.
        OSError: the port is in use, or not for this user.
    """

    daemon_threads = allow_reuse_address = True

    def __init__(self, folder: str | os.PathLike, port: int = 0, *, most: int, task: Gym | Hexapod | None = None) -> None:
        self.followed, self.token = Followed(Path(folder), most, task), secrets.token_urlsafe()
        try:
            super().__init__((_LOOPBACK, port), _Handler)
        except OSError as error:
            other = "another program listens on it" if error.errno == errno.EADDRINUSE else error.strerror
            raise told(OSError(error.errno, other), f"port {port} cannot be used") from None

    @property
    def url(self) -> str:
        """With the token."""
        return f"http://{_LOOPBACK}:{self.server_address[1]}/?token={self.token}"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser that has gone away is no trouble."""
        if not isinstance(sys.exception(), ConnectionError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    server: Server  # pyright: ignore[reportIncompatibleVariableOverride]
    timeout = _PATIENCE
    server_version, sys_version = "auroraqd", ""

    def do_GET(self) -> None:
        """Answer, if whoever asks may know."""
        try:
            address = urlsplit(self.path)
        except ValueError:
            return self._send("the address is none", code=HTTPStatus.BAD_REQUEST)
        query = parse_qs(address.query)
        if not self._permitted(query.get("token", [""])[0]):
            return self._send("the address must be the one that `auroraqd explore --serve` printed", code=HTTPStatus.FORBIDDEN)
        answers = {
            "/": lambda: self._send(*self.server.followed.page()),
            "/state": lambda: self._send_json(self.server.followed.state()),
            "/film": partial(self._film, query.get("id", [""])[0]),
        }
        if address.path not in answers:
            return self._send("there is no such page", code=HTTPStatus.NOT_FOUND)
        answers[address.path]()

    do_HEAD = do_GET

    def _permitted(self, token: str) -> bool:
        host = self.headers.get("Host", "").rpartition(":")[0] or self.headers.get("Host", "")
        return host in _HOSTS and secrets.compare_digest(token.encode(), self.server.token.encode())

    def _film(self, id: str) -> None:
        try:
            if not id.isdecimal():
                raise ValueError(f"id must be that of a skill, a whole number, got {shown(id)}")
            self._send_json(self.server.followed.film(int(id)))
        except Exception as error:  # the task is somebody else's
            kind = "" if isinstance(error, OSError | ValueError) else f"{type(error).__name__}: "
            self._send_json({"trouble": f"{kind}{error}"})

    def _send_json(self, values: Any) -> None:
        self._send(json.dumps(values), kind="application/json")

    def _send(self, text: str, nonce: str = "", *, kind: str = "", code: HTTPStatus = HTTPStatus.OK) -> None:
        content = text.encode()
        self.send_response(code)
        headers = {
            "Content-Type": kind or ("text/html; charset=utf-8" if nonce else "text/plain; charset=utf-8"),
            "Content-Length": str(len(content)),
            "Content-Security-Policy": policy(nonce, connect="'self'") + "; frame-ancestors 'none'",
            "Cross-Origin-Resource-Policy": "same-origin",
            "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer",  # it would have the token
            "Cache-Control": "no-store",
        }
        for name, value in headers.items():
            self.send_header(name, value)
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(content)

    def log_message(self, format: str, *args: Any) -> None:
        """Nothing: the token is in what is asked for."""
