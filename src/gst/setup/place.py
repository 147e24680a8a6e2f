"""A local page that takes a study from its files to its result: `gst place FOLDER`.

The server listens on this machine alone. It answers whoever knows the token in the page's address,
and asks for it under the server's own name, so that no other page in the same browser can. It reads
the study's folder, its mesh and its scans, and takes no files. Everything that is done on the page
is in the config and the patch table (`gst.setup.place_state`).

Nothing is overwritten that a page has not seen. A request that changes files names the digest of
the files that its page shows, and a folder has one server at a time. No file is written through a
link.
"""

import fcntl
import json
import os
import re
import secrets
import signal
import subprocess
import sys
import tempfile
import threading
import traceback
import webbrowser
from collections.abc import Callable, Mapping
from http import HTTPStatus
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import psutil

from gst.config.contradictions import files_read
from gst.config.reading import read_study, read_unfinished
from gst.page.viewer import shipped, three_js
from gst.run.chain import LEVELS, break_in, other_files
from gst.setup.place_scans import find_places, has_stage, picture_of
from gst.setup.place_state import (
    check_files,
    digest_of,
    save_answers,
    save_cure,
    save_file,
    save_places,
    state_of,
    stone_of,
)
from gstlib.errors import GstError, InputError
from gstlib.io.files import check_regular

# The files of the page, by the room in which they lie.
_FILES = dict.fromkeys(
    ("place.css", "place.html", "place.js", "square.js"), "gst.setup"
)
_FILES |= dict.fromkeys(("page.css", "viewer.js"), "gst.page") | {"three.js": ""}
_JSON = "application/json"
# Most bytes that a page sends: ten thousand patches.
_MOST_SENT = 2_000_000
# Policies of content, a directive in each line.
_POLICY = """
default-src 'none'
script-src 'self'
style-src 'self'
img-src 'self' data:
connect-src 'self'
frame-src 'self'
base-uri 'none'
form-action 'none'
frame-ancestors 'none'
"""
# A result's page has its scripts and pictures in it, and asks for nothing. Results may come from
# somebody else: the sandbox keeps their scripts away from this server's own pages.
_POLICY_OF_RESULTS = """
sandbox allow-scripts allow-downloads
default-src 'none'
script-src 'unsafe-inline'
style-src 'unsafe-inline'
img-src 'self' data:
base-uri 'none'
form-action 'none'
frame-ancestors 'self'
"""
# Logs and numbers of processes are kept beside Snakemake's own files.
_LOGS = Path(".snakemake")
_LOCK = _LOGS / "place.lock"
# Requests that change the config or the patch table, and the header with the digest of both files.
_CHANGES = {"answers", "cure", "file", "places"}
_DIGEST = "Study-Digest"
_COMMANDS = {"check": ("gst.setup.place_check",), "study": ("gst", "study")}


class _RefusedError(Exception):
    """A request that is not answered."""

    def __init__(self, status: HTTPStatus, why: str):
        super().__init__(why)
        self.status = status


class _Command:
    """A command of `gst` in a process of its own, which outlives the page and the server.

    Its messages are in a file, its number in another, so that a later server finds both.
    """

    def __init__(self, name: str, config: Path):
        self._config = config
        self._words = ["-m", *_COMMANDS[name], str(config)]
        self._log, self._number = (
            _LOGS / f"place_{name}.{kind}" for kind in ("log", "pid")
        )
        self._own: subprocess.Popen | None = None

    def start(self) -> None:
        """Start it; nothing happens while it runs."""
        if self.is_running():
            return
        # a link in their place may lead anywhere: new files are made
        for file in (self._log, self._number):
            file.unlink(missing_ok=True)
        # -P: not a folder `gst` in the study's own
        with self._log.open("xb") as log:
            self._own = subprocess.Popen(
                [sys.executable, "-P", "-u", *self._words],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,  # Ctrl-C ends the server alone
            )
        with self._number.open("x") as number:
            print(self._own.pid, file=number)

    def stop(self) -> None:
        """Ask it to end; a study keeps the steps that are done."""
        if (process := self._running()) is not None:
            process.terminate()

    def report(self) -> dict[str, Any]:
        """Its messages so far, by level, and its state.

        The state is whether it is ``running``, its exit ``code`` if there is one, and whether the
        config was ``changed`` since then. A check that has ended reports its ``causes``.
        """
        is_running = self.is_running()
        text, changed = "", False
        if self._log.is_file():
            text = self._log.read_text("utf-8", "replace")
            changed = self._config.stat().st_mtime > self._log.stat().st_mtime
        code = self._own.returncode if self._own is not None else None
        state = {"running": is_running, "code": code, "changed": changed}
        if (check := _causes(text)) is not None:
            changed = check["digest"] != digest_of(self._config)
            return state | check | {"records": [], "changed": changed}
        return {"records": _records(text)} | state

    def is_running(self) -> bool:
        return self._running() is not None

    def _running(self) -> psutil.Process | None:
        if self._own is not None and self._own.poll() is not None:
            return None
        try:
            check_regular(self._number)
            process = psutil.Process(int(self._number.read_text(encoding="utf-8")))
            # numbers are given again
            is_it = process.cmdline()[-len(self._words) :] == self._words
            return process if is_it and process.cwd() == str(Path.cwd()) else None
        except (InputError, OSError, ValueError, psutil.Error):
            return None


def _causes(text: str) -> dict[str, Any] | None:
    """The output of `gst.setup.place_check`; None until it ends, or if it was interrupted."""
    try:
        check = json.loads(text.splitlines()[-1])  # after warnings of other packages
    except (ValueError, IndexError):
        return None
    return check if isinstance(check, dict) and "causes" in check else None


def _records(text: str) -> list[dict[str, str]]:
    """Messages with their level: error, warning, note or text."""
    records: list[dict[str, str]] = []
    for line in text.splitlines():
        name, _, message = line.partition(": ")
        level = name.lower() if name in LEVELS else "text"
        if records and (line[:1] == " " or level == "text" == records[-1]["level"]):
            records[-1]["text"] += f"\n{line}"
        elif line.strip():
            text = line if level == "text" else message
            records.append({"level": level, "text": text})
    return records


def _locked() -> int:
    """The open lock of the working folder, which ends with the process, even if it is killed.

    Raises an `InputError` if another server has it.
    """
    if _LOGS.is_symlink():
        problem = "is a link, and no file is written through a link"
        raise InputError(_LOGS, problem, "Put a folder in its place.")
    try:
        _LOGS.mkdir(exist_ok=True)
        lock = os.open(_LOCK, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        problem = "is already open in another `gst place`"
        remedy = "Use that page, or end that process first."
        raise InputError(Path.cwd(), problem, remedy) from None
    except OSError as error:
        problem = f"cannot be the lock of this folder: {error.strerror}"
        remedy = (
            "Remove it, or copy the study to a folder that you can write to and lock."
        )
        raise InputError(_LOCK, problem, remedy) from None
    return lock


class PlaceServer(ThreadingHTTPServer):
    """The server of a study in the working folder, on a free port of this machine.

    Raises an `InputError` if the folder has another server.
    """

    # a page asks for many pictures at once; beyond the queue, connections are reset
    request_queue_size = 128

    daemon_threads = True

    def __init__(self, config: Path):
        self.lock = threading.Lock()
        self._lock_of_folder = _locked()
        self.redirect = tempfile.NamedTemporaryFile(  # noqa: SIM115
            "w", dir=_LOGS.resolve(), prefix="place-", suffix=".html"
        )
        super().__init__(("127.0.0.1", 0), _Handler)
        self.config = config
        self.token = secrets.token_urlsafe(24)
        self.host = f"127.0.0.1:{self.server_port}"
        self.url = f"http://{self.host}/{self.token}/"
        self.commands = {name: _Command(name, config) for name in _COMMANDS}
        self.mended = ""  # digest of files that only cures and consent changed

    def server_close(self) -> None:
        """Release the port and the folder."""
        super().server_close()
        self.redirect.close()
        # A save that is under way ends first, and none follows. A search only reads files.
        self.lock.acquire(timeout=5)
        os.close(self._lock_of_folder)

    def open_browser(self) -> None:
        """Open the page in the browser, by a private file that redirects to it.

        All users of a machine can read the arguments of its processes, but not this file. It is
        removed once the page has been opened. It is in the study, because a browser from a sandbox
        such as Snap cannot read the machine's temporary files.
        """
        self.redirect.write(f'<meta http-equiv="refresh" content="0; url={self.url}">')
        self.redirect.flush()
        webbrowser.open(Path(self.redirect.name).as_uri())

    def check_digest(self, digest: str | None) -> None:
        """Refuse to change files that differ from those that a page shows, or are being read."""
        self.check_idle()
        if digest != digest_of(self.config):
            why = (
                f"Another tab or program has changed {self.config} or its patch table, so nothing "
                "was saved. Note your entries, then reload the page."
            )
            raise _RefusedError(HTTPStatus.CONFLICT, why)
        check_files(self.config)

    def check_idle(self, but: str = "") -> None:
        """Refuse a change during a command, except the command `but` itself."""
        for name, command in self.commands.items():
            if name != but and command.is_running():
                why = f"The {name} is running and reads its files. Wait until it ends, or stop it."
                raise _RefusedError(HTTPStatus.LOCKED, why)

    def command(self, name: str) -> _Command:
        if name not in self.commands:
            raise _RefusedError(HTTPStatus.NOT_FOUND, "no such command")
        return self.commands[name]

    def start(self, name: str) -> None:
        """Start a command, unless the other one runs."""
        self.check_idle(but=name)
        self.mended = ""
        self.command(name).start()

    def _causes(self) -> list[dict[str, Any]]:
        """The causes that the check found; none if the files have changed, except by cures."""
        report = self.commands["check"].report()
        is_other = report["changed"] and digest_of(self.config) != self.mended
        return [] if is_other else report.get("causes", [])

    def cure(self, number: int) -> str | None:
        """Write the cure of a cause of the check into the files that were checked."""
        causes = self._causes()
        if not 0 <= number < len(causes) or "cure" not in causes[number]:
            why = "The study has changed since the check. Check it again first."
            raise _RefusedError(HTTPStatus.UNPROCESSABLE_ENTITY, why)
        kept = save_cure(self.config, **causes[number]["cure"])
        self.mended = digest_of(self.config)
        return kept

    def answer(self, sent: Mapping[str, Any]) -> str | None:
        """Save answers of the page; a fault that is accepted leaves the other cures valid."""
        causes = self._causes()
        kept = save_answers(self.config, sent)
        if causes and {*sent} == {"accept"}:
            self.mended = digest_of(self.config)
        return kept

    def result(self) -> dict[str, Any]:
        """The address of the result's page, or None, and why it is missing or outdated."""
        config = read_unfinished(self.config)
        folder = Path(config["results"])
        if not (folder / "index.html").is_file():
            return {"page": None, "problem": "the study has not finished yet"}
        broken = break_in(folder, config)
        if broken is None:
            try:
                patches = read_study(config, str(self.config))
                broken = other_files(folder, files_read(config, patches))
            except GstError as error:  # several files fit a name now
                broken = str(error)
        return {"page": "results/index.html", "problem": broken}

    def result_file(self, name: str) -> Path:
        """A file of the results, which are in the study's folder; or a folder, named with a /."""
        folder = Path(os.path.realpath(read_unfinished(self.config)["results"]))
        file = Path(os.path.realpath(folder / (name or "index.html")))
        if not (file.is_relative_to(folder) and folder.is_relative_to(Path.cwd())):
            why = "the file is outside the study's results"
            raise _RefusedError(HTTPStatus.FORBIDDEN, why)
        if not (file.is_dir() if name.endswith("/") else file.is_file()):
            raise _RefusedError(HTTPStatus.NOT_FOUND, "no such file")
        return file


# The answer to a request, by its method and the first part of its path. It takes the server and the
# rest of the path, or else the data that were sent. Bytes are a picture, and all else is JSON.
_ANSWERS: dict[str, Callable[["PlaceServer", Any], Any]] = {
    "GET state": lambda server, _: state_of(server.config),
    "GET stone": lambda server, _: stone_of(server.config),
    "GET stage": lambda server, _: {"all": has_stage(server.config)},
    "GET scan": lambda server, rest: picture_of(server.config, _number(rest)),
    "GET report": lambda server, rest: server.command(rest).report(),
    "GET result": lambda server, _: server.result(),
    "POST find": lambda server, _: find_places(server.config),
    "POST answers": lambda server, sent: server.answer(sent),
    "POST cure": lambda server, sent: server.cure(sent),
    "POST file": lambda server, sent: save_file(server.config, **sent),
    "POST places": lambda server, sent: save_places(server.config, **sent),
    "POST start": lambda server, rest: server.start(rest),
    "POST stop": lambda server, rest: server.command(rest).stop(),
    "POST end": lambda _server, _rest: None,
}


def _number(text: str) -> int:
    if not re.fullmatch(r"\d{1,5}", text):
        raise _RefusedError(HTTPStatus.NOT_FOUND, "no such scan")
    return int(text)


class _Handler(SimpleHTTPRequestHandler):
    server: PlaceServer
    timeout = 60
    # headers of the answer
    policy = _POLICY
    cache = "no-store"

    def log_message(self, *_: Any) -> None:
        """Log nothing, because the token is in every address."""

    def _answer(self) -> None:
        try:
            name = self._asked_for() or "place.html"
            first, _, rest = name.partition("/")
            if name in _FILES:
                self.server.redirect.close()  # a page has been opened
                self._send_file(name)
            elif first == "results":
                self._send_result(self.server.result_file(rest))
            else:
                self._send_content(self._content(first, rest))
            if first == "end":  # its answer has been sent
                self.server.shutdown()
        except _RefusedError as refused:
            self._send_error(str(refused), refused.status)
        except ConnectionError:
            pass  # the page was closed meanwhile
        except (GstError, OSError) as error:
            self._send_error(str(error), HTTPStatus.UNPROCESSABLE_ENTITY)
        except Exception:  # a bug, or a config that no check has seen yet
            traceback.print_exc()
            why = "Unexpected error. The terminal shows the details. Reload the page to continue."
            self._send_error(why, HTTPStatus.INTERNAL_SERVER_ERROR)

    do_GET = do_HEAD = do_POST = _answer

    def _content(self, first: str, rest: str) -> Any:
        """The answer to a request for data, or with data."""
        answer = _ANSWERS.get(f"{self.command} {first}")
        if answer is None:
            raise _RefusedError(HTTPStatus.NOT_FOUND, "no such page")
        sent = self._sent() if self.command == "POST" else None
        with self.server.lock:
            if first in _CHANGES:
                self.server.check_digest(self.headers.get(_DIGEST))
            content = answer(self.server, rest or sent)
            if first in _CHANGES:  # and perhaps the copy of a file that lost a part
                content = {"digest": digest_of(self.server.config), "kept": content}
        return content

    def _asked_for(self) -> str:
        """The path behind the token. Requests from elsewhere are refused."""
        own = f"http://{self.server.host}"
        is_own = self.headers.get("Host") == self.server.host
        is_own &= self.headers.get("Origin", own) == own
        path = self.path.partition("?")[0].removeprefix("/")
        token, _, rest = path.partition("/")
        is_own &= secrets.compare_digest(token.encode(), self.server.token.encode())
        if not is_own:
            why = "request refused: it has another address, or comes from another page"
            raise _RefusedError(HTTPStatus.FORBIDDEN, why)
        name = unquote(rest)
        if not name.isprintable():  # such as a NUL, which no path can have
            raise _RefusedError(HTTPStatus.NOT_FOUND, "no such page")
        return name

    def _sent(self) -> Any:
        """The JSON of a request."""
        length = self.headers.get("Content-Length", "")
        if not length.isdecimal() or int(length) > _MOST_SENT:
            raise _RefusedError(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "too long")
        try:
            # neither NaN nor Infinity, which JSON does not have
            return json.loads(self.rfile.read(int(length)), parse_constant=int)
        except (ValueError, RecursionError):
            raise _RefusedError(HTTPStatus.BAD_REQUEST, "not JSON") from None

    def _send_error(self, why: str, status: HTTPStatus) -> None:
        self._send(json.dumps({"error": why}).encode(), _JSON, status)

    def _send_file(self, name: str) -> None:
        room = _FILES[name]
        text = shipped(name, room) if room else three_js()
        self._send(text.encode(), f"{self.guess_type(name)}; charset=utf-8")

    def _send_result(self, path: Path) -> None:
        self.policy = _POLICY_OF_RESULTS
        if path.is_file():
            self._send(path.read_bytes(), self.guess_type(path))
        elif listing := self.list_directory(path):
            self.copyfile(listing, self.wfile)

    def _send_content(self, content: Any) -> None:
        if isinstance(content, bytes):
            self.cache = "private, max-age=86400"
            self._send(content, "image/png")
        else:
            self._send(json.dumps(content).encode(), _JSON)

    def _send(
        self, content: bytes, kind: str, status: HTTPStatus = HTTPStatus.OK
    ) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def end_headers(self) -> None:
        policy = "; ".join(self.policy.strip().splitlines())
        self.send_header("Content-Security-Policy", policy)
        self.send_header("Cache-Control", self.cache)
        self.send_header("Referrer-Policy", "same-origin")
        self.send_header("X-Content-Type-Options", "nosniff")
        super().end_headers()


def serve(config: Path, *, browser: bool) -> None:
    """Serve the page of a study in the working folder until Ctrl-C, or until the page ends it."""
    read_unfinished(config)  # in a sentence, before anything opens
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) == signal.SIG_DFL:
            signal.signal(number, signal.default_int_handler)  # as Ctrl-C does
    with PlaceServer(config) as server:
        print(server.url)
        print("Only this machine can open the page. Ctrl-C ends gst place.", flush=True)
        if browser:
            hint = "If the browser does not show the page, open this address in it."
            print(hint, flush=True)
            server.open_browser()
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            print()
        if server.commands["study"].is_running():
            print("The study is still running. Open the page again to see or stop it.")
