"""HTTP server of the page of `sepmc studio`, for this machine alone.

Every request needs the token, which is part of the address, and the host name that the server is
bound to. Another page in the same browser knows neither (DNS rebinding), and no other machine can
connect.
"""

import secrets
from collections.abc import Callable
from http import HTTPStatus as Http
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import msgspec

from sepmc.report.page import resource, templates
from sepmc.scene.messages import InputError
from sepmc.studio.answers import Question, Studio, as_json

HOST = "127.0.0.1"
_MAX_BODY = 1_000_000  # bytes of a question
_DIGITS = 7  # of that number: Python refuses to read thousands of them
_IDLE_S = 60.0  # a connection without a request is closed
_JSON, _SCRIPT, _PAGE = "application/json", "text/javascript", "text/html"
# the page may load nothing but its own scripts and answers
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'unsafe-inline'; connect-src 'self'; "
    "img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": _POLICY,
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
_SCRIPTS = {
    "replay.js": "sepmc.report",
    "figures.js": "sepmc.studio",
    "studio.js": "sepmc.studio",
}
_QUESTIONS = ("run", "replay", "map", "slider", "settings")


class Server(ThreadingHTTPServer):
    """HTTP server of a studio. A new one is bound to a port of this machine, but not yet serving;
    `address` has that port.

    Parameters
    ----------
    studio : Studio
        Answers the questions of the page.
    port : int
        Port to bind to; 0: any free one.

    Raises
    ------
    InputError
        If the port cannot be used.
    """

    daemon_threads = True
    request_queue_size = 128  # connections that wait; more than the few of the default are reset
    block_on_close = False

    def __init__(self, studio: Studio, port: int = 0):
        try:
            super().__init__((HOST, port), _Handler)
        except OSError as error:
            reason = error.strerror or error
            raise InputError(f"--port = {port}: cannot be used: {reason}") from None
        self.studio, self.token = studio, secrets.token_urlsafe(32)
        number = self.server_address[1]
        self.hosts = (f"{HOST}:{number}", f"localhost:{number}")
        page = templates("sepmc.studio").get_template("studio.html.j2").render(studio.start())
        self.files: dict[str, tuple[str, bytes]] = {"": (_PAGE, page.encode())}
        for name, package in _SCRIPTS.items():
            self.files[name] = (_SCRIPT, resource(name, package).encode())

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore an error of a request, such as a connection that the browser has closed."""

    @property
    def address(self) -> str:
        """Address of the page, ``http://HOST:PORT/TOKEN/``."""
        return f"http://{self.hosts[0]}/{self.token}/"


class _Handler(BaseHTTPRequestHandler):
    """Answers the requests of one connection."""

    protocol_version, server_version, sys_version = "HTTP/1.1", "sepmc", ""
    timeout = _IDLE_S
    server: Server

    def parse_request(self) -> bool:
        """Read the head of a request and set `name`, the path after the token. Return False, after
        an error was sent, if the request is malformed, lacks the token, or does not come from the
        page of this server."""
        if not super().parse_request():
            return False
        empty, _, path = self.path.partition("/")
        token, _, self.name = path.partition("/")
        origin = self.headers.get("Origin")
        allowed = (
            not empty
            and secrets.compare_digest(token.encode(), self.server.token.encode())
            and self.headers.get_all("Host") in [[host] for host in self.server.hosts]
            and origin in (None, *(f"http://{host}" for host in self.server.hosts))
        )
        if not allowed:
            self._refuse(Http.FORBIDDEN, "the address must contain the token that sepmc printed")
        return allowed

    def do_GET(self) -> None:
        """Send the page, a script, or the latest message of the run in progress as JSON; an error
        404 for any other path."""
        if self.name == "message":
            self._send(Http.OK, _JSON, as_json({"message": self.server.studio.message}))
        elif self.name in self.server.files:
            self._send(Http.OK, *self.server.files[self.name])
        else:
            self._refuse(Http.NOT_FOUND, "no such page")

    def do_POST(self) -> None:
        """Send the answer of the studio to the question in the body of the request, both as JSON.
        The last part of the path, `name`, is the method of `Studio` that answers. If that raises an
        error, send ``{"error": message}`` with an error status; an unknown name or a body that is
        too long is refused."""
        size = self.headers.get("Content-Length", "")
        if self.name not in _QUESTIONS:
            return self._refuse(Http.NOT_FOUND, "no such question")
        is_short = size.isascii() and size.isdigit() and len(size) <= _DIGITS
        if not (is_short and int(size) <= _MAX_BODY):
            return self._refuse(Http.REQUEST_ENTITY_TOO_LARGE, "a question must have a short body")
        body = self.rfile.read(int(size))
        ask: Callable[[Question], Any] = getattr(self.server.studio, self.name)
        try:
            answer = as_json(ask(msgspec.json.decode(body, type=Question)))
        except (InputError, msgspec.ValidationError, msgspec.DecodeError) as error:
            self._send(Http.BAD_REQUEST, _JSON, as_json({"error": str(error)}))
        except Exception as error:  # the page shows it, and the next question is answered
            text = f"{type(error).__name__}: {error}"
            self._send(Http.INTERNAL_SERVER_ERROR, _JSON, as_json({"error": text}))
        else:
            self._send(Http.OK, _JSON, answer)
        return None

    def _refuse(self, status: Http, reason: str) -> None:
        """Send a status with a reason as text, and close the connection, as the body of the request
        was not read."""
        self.close_connection = True
        self._send(status, "text/plain", reason.encode())

    def _send(self, status: Http, kind: str, body: bytes) -> None:
        """Send an answer, to a HEAD request without its ``body``; ``kind`` is its media type, such
        as text/html, to which charset=utf-8 is added."""
        self.send_response(status)
        for name, value in _HEADERS.items():
            self.send_header(name, value)
        self.send_header("Content-Type", f"{kind}; charset=utf-8")
        self.send_header("Content-Length", str(len(body)))
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """Log nothing."""
