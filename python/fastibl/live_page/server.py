"""The page's server: for this machine alone, with a token in every address, and with limits on all that a client can
make it do."""

from __future__ import annotations

import base64
import contextlib
import errno
import hashlib
import hmac
import json
import os
import re
import secrets
import socketserver
import sys
import threading
import time
from collections.abc import Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, HTTPServer
from importlib import resources
from typing import Any
from urllib.parse import parse_qs, urlsplit

from .board_advice import BoardAdvice
from .connections import Connections
from .loop import LiveLoop, free_path
from .pictures import Pictures, save_picture
from .state import overlay_of, state_of
from .threads import Threads
from .viewers import Viewers

ADDRESS = "127.0.0.1"
_CONNECTIONS = 32  # connections at a time; a browser opens six per page
_BODY = 4096  # bytes of a request's body
_TIMEOUT = 10.0  # seconds that a client may take for a whole request, including silence before it, or to take an answer
_WAIT = 2.0  # seconds that a request waits for the next picture
_TOKEN = 16  # characters of a given token, at least: 96 random bits
_ASSETS = ("page.css", "page.js")


class _Refusal(Exception):
    """Tells a client that it does not get what it asked for, and why."""

    def __init__(self, status: HTTPStatus, text: str, headers: Mapping[str, str] | None = None):
        super().__init__(text)
        self.status, self.headers = status, headers or {}


def load_page() -> tuple[bytes, str]:
    """The page in one file, and a Content-Security-Policy that allows only that file's style and script."""
    files = resources.files(__package__)
    css, js = ((files / name).read_text("utf-8") for name in _ASSETS)
    page = (files / "page.html").read_text("utf-8").replace("/*STYLE*/", css).replace("/*SCRIPT*/", js)
    style, script = (
        "'sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() + "'" for text in (css, js)
    )
    policy = (
        f"default-src 'none'; script-src {script}; style-src {style}; connect-src 'self'; img-src data:; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
    return page.encode(), policy


def check_token(token: str) -> str:
    """The token itself. Raises ValueError, which does not show it, where it could be guessed or is no part of an
    address."""
    if not re.fullmatch(r"[A-Za-z0-9_-]*", token):
        raise ValueError("a token consists of letters, digits, - and _")
    if len(token) < _TOKEN or len(set(token)) < _TOKEN // 2:
        raise ValueError(f"a token must have {_TOKEN} random characters or more, got {len(token)}")
    return token


class PageServer:
    """Serves a LiveLoop at `url` until close(); a context manager.

    port: 0 takes a free one. viewers: pages that may be open at a time. notices: texts that the page always shows.
    token: the secret in the page's address, for an address that stays; by default a new one.
    Raises OSError where the port is in use, ValueError for a token that is too short or has other characters than those
    of an address.
    """

    def __init__(
        self,
        loop: LiveLoop,
        port: int = 0,
        *,
        viewers: int = 4,
        notices: tuple[str, ...] = (),
        token: str | None = None,
    ):
        self.loop, self.notices = loop, notices
        self.token = secrets.token_urlsafe(16) if token is None else check_token(token)
        self.pictures, self.advice, self.viewers = Pictures(), BoardAdvice(), Viewers(viewers)
        self.page, self.policy = load_page()
        self.seconds: dict[str, float] = {}  # seconds of processor time, by what was asked for
        self.served: dict[str, int] = {}
        self._counting = threading.Lock()
        try:
            self._server = _Server((ADDRESS, port), self)
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise
            raise OSError(f"port {port} is in use; leave --port away for a free one") from error
        self.port = self._server.server_address[1]
        self.url = f"http://{ADDRESS}:{self.port}/{self.token}/"
        self._thread = threading.Thread(target=self._server.serve_forever, name="fastibl page", daemon=True)
        self._thread.start()

    @property
    def connections(self) -> int:
        """Number of open connections."""
        return len(self._server.connections)

    def count(self, what: str, seconds: float) -> None:
        with self._counting:
            self.seconds[what] = self.seconds.get(what, 0.0) + seconds
            self.served[what] = self.served.get(what, 0) + 1

    def close(self) -> None:
        self.loop.latest.close()
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def __enter__(self) -> PageServer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class _Server(HTTPServer):
    """Answers each connection in a thread of its own. Tells those that find no place so, and closes them."""

    allow_reuse_address = os.name == "posix"  # on other systems, reuse would let two servers share the port
    request_queue_size = 16

    def __init__(self, address: tuple[str, int], page: PageServer):
        self.page, self.connections = page, Connections(_CONNECTIONS, _TIMEOUT)
        self._threads = Threads("fastibl page's connection")
        super().__init__(address, _Handler)

    def server_bind(self) -> None:
        """Binds without HTTPServer's look-up of the host's name, which may take seconds."""
        socketserver.TCPServer.server_bind(self)
        self.server_name, self.server_port = ADDRESS, self.server_address[1]

    def process_request(self, request: Any, client_address: Any) -> None:
        if self.connections.take(request):
            return self._threads.run(lambda: self._serve(request, client_address))
        with contextlib.suppress(OSError):
            request.settimeout(0.1)
            request.sendall(b"HTTP/1.1 503 Service Unavailable\r\nConnection: close\r\nContent-Length: 0\r\n\r\n")
        self.shutdown_request(request)
        return None

    def _serve(self, request: Any, client_address: Any) -> None:
        try:
            self.finish_request(request, client_address)
        except Exception:
            self.handle_error(request, client_address)
        finally:
            self.shutdown_request(request)
            self.connections.leave(request)

    def server_close(self) -> None:
        super().server_close()
        self._threads.close()

    def service_actions(self) -> None:
        """Ends late connections; called twice a second and after each new connection."""
        self.connections.end_late()

    def handle_error(self, request: Any, client_address: Any) -> None:
        if not isinstance(sys.exc_info()[1], (ConnectionError, TimeoutError)):  # clients come and go: that is no error
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "fastibl", ""
    timeout = _TIMEOUT
    disable_nagle_algorithm = True
    default_request_version = "HTTP/1.0"  # version of the answer to a request that names none
    server: _Server
    raw_requestline: bytes  # attributes of the base class that its stub lacks
    _headers_buffer: list[bytes]

    def handle_one_request(self) -> None:
        self.server.connections.wait(self.connection)
        super().handle_one_request()

    def parse_request(self) -> bool:
        """Refuses HTTP/0.9, whose requests end with the first line, and which has no status to refuse them with."""
        words = self.raw_requestline.split()
        if not words or words[-1] in (b"HTTP/1.0", b"HTTP/1.1"):
            return super().parse_request()
        self.requestline = self.command = ""
        self.request_version = self.default_request_version
        self.send_error(HTTPStatus.HTTP_VERSION_NOT_SUPPORTED, "a request ends its first line with HTTP/1.1")
        return False

    def do_GET(self) -> None:  # noqa: N802 - the library's name
        self._answer({"": self._page, "choices": self._choices, "state": self._state, "picture": self._picture})

    def do_POST(self) -> None:  # noqa: N802
        self._answer({"control": self._control, "save": self._save, "leave": self._leave})

    def log_message(self, *_: Any) -> None:
        """Logs nothing: the terminal is for the user."""

    def _answer(self, kinds: Mapping[str, Any]) -> None:
        begin = time.thread_time()
        what = ""
        try:
            body = self._read_body()
            path, self.asked = self._admitted()
            self.server.connections.admit(self.connection)
            what, _, self.rest = path.partition("/")
            if what not in kinds:
                raise _Refusal(HTTPStatus.NOT_FOUND, "there is no such page")
            status, kind, answer, headers = kinds[what](body)
        except _Refusal as refusal:
            self.close_connection = True  # a client that was refused keeps no place
            status, kind, headers = refusal.status, "text/plain; charset=utf-8", refusal.headers
            answer = f"{refusal}\n".encode()
        self._send(status, kind, answer, headers)
        view = f"/{self.rest}" if what == "picture" and status == HTTPStatus.OK else ""
        self.server.page.count(
            (what or "page" if what in kinds else "others") + view,
            time.thread_time() - begin,
        )

    def _send(self, status: HTTPStatus, kind: str, answer: bytes, headers: Mapping[str, str]) -> None:
        self.send_response(status)
        if status != HTTPStatus.NO_CONTENT:
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(answer)))
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("Cross-Origin-Resource-Policy", "same-origin")
        for name, value in headers.items():
            self.send_header(name, value)
        if self.close_connection:
            self.send_header("Connection", "close")
        # Everything is sent at once: a second small packet would wait until the first one is acknowledged.
        self._headers_buffer.append(b"\r\n" + answer)
        self.wfile.write(b"".join(self._headers_buffer))
        self._headers_buffer = []

    # Who may ask.

    def _admitted(self) -> tuple[str, dict[str, str]]:
        """The path below the token, and the parameters of the request."""
        page = self.server.page
        host = self.headers.get("Host", "")
        if host not in (f"{ADDRESS}:{page.port}", f"localhost:{page.port}"):  # another name that leads to it
            raise _Refusal(HTTPStatus.FORBIDDEN, f"this server is {ADDRESS}:{page.port} and goes by no other name")
        origin = self.headers.get("Origin")
        try:
            parts = urlsplit(self.path)
        except ValueError:
            raise _Refusal(HTTPStatus.BAD_REQUEST, "this is no address") from None
        token, slash, path = parts.path.lstrip("/").partition("/")
        foreign = self.headers.get("Sec-Fetch-Site", "none") not in ("none", "same-origin")
        # A link to the page that is followed from elsewhere is allowed: its address holds the token, and no frame may
        # show it.
        followed = self.command == "GET" and not path and self.headers.get("Sec-Fetch-Dest") == "document"
        if (foreign and not followed) or (origin is not None and origin != f"http://{host}"):
            raise _Refusal(HTTPStatus.FORBIDDEN, "other pages may not ask here")
        if not hmac.compare_digest(token.encode(), page.token.encode()):
            raise _Refusal(HTTPStatus.FORBIDDEN, "open the address that `fastibl live` printed: it ends in a token")
        if not slash:
            raise _Refusal(HTTPStatus.PERMANENT_REDIRECT, "the address ends in /", {"Location": f"/{token}/"})
        return path, {name: values[-1] for name, values in parse_qs(parts.query).items()}

    def _viewer(self) -> None:
        viewers = self.server.page.viewers
        try:
            admitted = viewers.admit(self.asked.get("viewer", ""))
        except ValueError as error:
            raise _Refusal(HTTPStatus.BAD_REQUEST, str(error)) from None
        if not admitted:
            raise _Refusal(
                HTTPStatus.SERVICE_UNAVAILABLE,
                f"{viewers.most} pages are open already, as many as are served: close one of them",
            )

    def _read_body(self) -> bytes:
        """Reads the body even if the request is refused: closing over unread bytes may take the answer from the client.

        Raises _Refusal for a body on a GET, or one that is too long or does not say how long it is. What is left unread
        then is not taken for a second request, because a refusal closes the connection.
        """
        lengths, chunked = self.headers.get_all("Content-Length", []), "Transfer-Encoding" in self.headers
        if self.command != "POST":
            if chunked or any(length != "0" for length in lengths):
                raise _Refusal(HTTPStatus.BAD_REQUEST, f"a {self.command} has no body here")
            return b""
        if chunked or len(lengths) != 1 or not lengths[0].isdecimal():
            raise _Refusal(HTTPStatus.LENGTH_REQUIRED, "a Content-Length is needed")
        if len(lengths[0]) > 9 or int(lengths[0]) > _BODY:
            raise _Refusal(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"a request may have {_BODY} bytes")
        return self.rfile.read(int(lengths[0]))

    # What may be asked.

    def _page(self, _: bytes) -> tuple[HTTPStatus, str, bytes, dict[str, str]]:
        page = self.server.page
        return HTTPStatus.OK, "text/html; charset=utf-8", page.page, {"Content-Security-Policy": page.policy}

    def _choices(self, _: bytes) -> tuple[HTTPStatus, str, bytes, dict[str, str]]:
        page = self.server.page
        return _json(page.loop.choices.describe() | {"notices": page.notices, "views": page.pictures.names})

    def _state(self, _: bytes) -> tuple[HTTPStatus, str, bytes, dict[str, str]]:
        self._viewer()
        page = self.server.page
        state = state_of(page.loop.latest.get(), page.pictures.light, page.advice)
        seconds, pictures = sum(page.seconds.values()), page.served.get("picture/composite", 0)
        return _json(state | {"viewers": len(page.viewers), "page": {"seconds": seconds, "pictures": pictures}})

    def _picture(self, _: bytes) -> tuple[HTTPStatus, str, bytes, dict[str, str]]:
        """The view's picture, as soon as it differs from the one that the client has."""
        self._viewer()
        page, after = self.server.page, self.asked.get("after", "0")
        if self.rest not in page.pictures.names or not (after.isdecimal() and len(after) < 19):
            raise _Refusal(HTTPStatus.NOT_FOUND, f"there are pictures of {', '.join(page.pictures.names)}")
        wait = _WAIT if self.asked.get("wait") else 0.0
        snapshot = page.loop.latest.wait_for_picture(int(after), wait, page.pictures.number(self.rest))
        encoded = page.pictures.get(self.rest, snapshot)
        if encoded is None or encoded.number == int(after):
            return HTTPStatus.NO_CONTENT, "", b"", {}
        headers = {"X-Picture": str(encoded.number)}
        drawn_by_back = self.rest in ("composite", "back")
        overlay = overlay_of(snapshot) if self.asked.get("overlay") and drawn_by_back else None
        if overlay is not None:
            headers["X-Overlay"] = json.dumps(overlay)
        return HTTPStatus.OK, "image/jpeg", encoded.data, headers

    def _control(self, body: bytes) -> tuple[HTTPStatus, str, bytes, dict[str, str]]:
        self._viewer()
        if self.headers.get_content_type() != "application/json":
            raise _Refusal(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "changes are sent as application/json")
        loop = self.server.page.loop
        try:
            changes = loop.choices.read(json.loads(body))
        except (ValueError, RecursionError) as error:
            raise _Refusal(HTTPStatus.BAD_REQUEST, str(error)) from None
        if not loop.change(changes):
            raise _Refusal(HTTPStatus.SERVICE_UNAVAILABLE, "too many changes wait for the next picture")
        return _json({"asked": list(changes)})

    def _save(self, _: bytes) -> tuple[HTTPStatus, str, bytes, dict[str, str]]:
        self._viewer()
        loop = self.server.page.loop
        try:
            saved = None
            while saved is None:  # another viewer may take the name in the meantime
                path = free_path(loop.folder, time.strftime("picture-%Y%m%d-%H%M%S"), (".png",))
                with contextlib.suppress(FileExistsError):
                    saved = save_picture(loop.latest.get(), path)
        except (OSError, ValueError) as error:
            raise _Refusal(HTTPStatus.CONFLICT, str(error)) from None
        loop.say(f"saved {saved}")
        return _json({"saved": str(saved)})

    def _leave(self, _: bytes) -> tuple[HTTPStatus, str, bytes, dict[str, str]]:
        self.server.page.viewers.leave(self.asked.get("viewer", ""))
        return HTTPStatus.NO_CONTENT, "", b"", {}


def _json(value: Any) -> tuple[HTTPStatus, str, bytes, dict[str, str]]:
    return HTTPStatus.OK, "application/json", json.dumps(value, allow_nan=False).encode(), {}


__all__ = ["ADDRESS", "PageServer", "check_token", "load_page"]
