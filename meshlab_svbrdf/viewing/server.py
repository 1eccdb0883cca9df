"""The page's server: on loopback alone, for whoever has the token, and nobody else.

Cookies and addresses are not enough on a machine that others use, too: requests need the token (in
the first address, then in a cookie that no script reads), a Host that is this server, so that no
name of elsewhere leads here, and a header that no other site's page may send.
"""

from __future__ import annotations

import hmac
import json
import logging
import secrets
from http.cookies import CookieError, SimpleCookie
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from typing import Any
from urllib.parse import parse_qs, urlsplit

from ..document.record import BusyError
from ..errors import SvbrdfError
from .routes import GET, POST, Answer, Refused
from .session import ConflictError, Session

HOST = "127.0.0.1"
TYPES = {"html": "text/html", "js": "text/javascript", "css": "text/css", "svg": "image/svg+xml"}
MOST_BYTES = 4 << 20
"""Of a request: a stroke of a hundred thousand points."""
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self' data:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}

log = logging.getLogger("meshlab_svbrdf")


class PageServer(ThreadingHTTPServer):
    """Serves a session; `address` is what to open in a browser.

    port : 0 takes a free one
    """

    daemon_threads = True
    allow_reuse_address = True

    def __init__(self, session: Session, port: int = 0) -> None:
        self.session = session
        self.token = secrets.token_urlsafe(24)
        page = files(__package__) / "page"
        self.pages = {file.name: file.read_bytes() for file in page.iterdir() if file.is_file()}
        super().__init__((HOST, port), _Handler)

    @property
    def address(self) -> str:
        return f"http://{HOST}:{self.server_port}/?token={self.token}"

    @property
    def cookie(self) -> str:
        """Its name: browsers share cookies between the ports of a host."""
        return f"svbrdf_{self.server_port}"


class _Handler(BaseHTTPRequestHandler):
    server: PageServer
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True  # a small answer must not wait for an acknowledgement
    wbufsize = 1 << 16
    server_version, sys_version = "meshlab-svbrdf", ""

    def do_GET(self) -> None:
        self._answer(self._get)

    def do_POST(self) -> None:
        self._answer(self._post)

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing: addresses hold the token."""

    # Who asks

    def _check_asker(self, query: dict[str, list[str]]) -> None:
        port = self.server.server_port
        if self.headers.get("Host") not in (f"{HOST}:{port}", f"localhost:{port}"):
            raise Refused("this server answers to its own address alone")
        given = query.get("token", [self._cookie()])[0]
        if not hmac.compare_digest(given.encode(), self.server.token.encode()):
            raise Refused("open the address that meshlab-svbrdf view printed, with its token")

    def _check_page(self) -> None:
        """Refuse what another site's page, or one of another port here, made a browser ask."""
        if self.headers.get("X-Svbrdf") != "1":
            raise Refused("this is asked by the page alone")

    def _cookie(self) -> str:
        try:
            cookies = SimpleCookie(self.headers.get("Cookie", ""))
        except CookieError:
            return ""
        found = cookies.get(self.server.cookie)
        return found.value if found else ""

    # What is asked

    def _get(self) -> Answer:
        address = urlsplit(self.path)
        query = parse_qs(address.query)
        self._check_asker(query)
        if address.path.startswith("/api/"):
            self._check_page()
            return self._route(GET, address.path, {k: v[0] for k, v in query.items()})
        name = address.path.removeprefix("/") or "index.html"
        if name not in self.server.pages:
            raise Refused(f"there is no {address.path} here", 404)
        kind = TYPES.get(name.rpartition(".")[2], "application/octet-stream")
        return Answer(self.server.pages[name], f"{kind}; charset=utf-8")

    def _post(self) -> Answer:
        length = self.headers.get("Content-Length", "")
        if not length.isdecimal() or len(length) > 12 or int(length) > MOST_BYTES:
            self.close_connection = True
            raise Refused(
                f"a request has at most {MOST_BYTES >> 20} MB, and says how long it is", 413
            )
        body = self.rfile.read(int(length))
        address = urlsplit(self.path)
        self._check_asker({})
        self._check_page()
        try:
            given = json.loads(body or b"{}")
        except (ValueError, RecursionError):
            raise Refused("expected JSON", 400) from None
        if not isinstance(given, dict):
            raise Refused("expected a JSON object", 400)
        return self._route(POST, address.path, given)

    def _route(self, routes: dict, path: str, given: dict[str, Any]) -> Answer:
        name = path.removeprefix("/api/")
        if name not in routes:
            raise Refused(f"there is no {path} here", 404)
        try:
            return routes[name](self.server.session, given)
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            log.debug("%s: %r", path, error, exc_info=True)
            raise Refused(f"{path} cannot do with what it was given ({error!r})", 400) from None

    # What is answered

    def _answer(self, work) -> None:
        try:
            status, answer = 200, work()
        except Refused as error:
            status, answer = error.status, Answer.json({"message": str(error)})
        except (ConflictError, BusyError) as error:
            status, answer = 409, Answer.json({"message": str(error)})
        except (SvbrdfError, OSError) as error:
            status, answer = 400, Answer.json({"message": str(error)})
        except Exception as error:
            log.exception("%s failed", urlsplit(self.path).path)
            status, answer = 500, Answer.json({"message": f"this failed unexpectedly: {error!r}"})
        try:
            self._send(status, answer)
        except (BrokenPipeError, ConnectionResetError):  # the page went away meanwhile
            self.close_connection = True

    def _send(self, status: int, answer: Answer) -> None:
        self.send_response(status)
        for name, value in (HEADERS | answer.headers).items():
            self.send_header(name, value)
        self.send_header("Content-Type", answer.type)
        self.send_header("Content-Length", str(len(answer.body)))
        if status == 200 and "token=" in urlsplit(self.path).query:
            self.send_header(
                "Set-Cookie",
                f"{self.server.cookie}={self.server.token}; Path=/; HttpOnly; SameSite=Strict",
            )
        self.end_headers()
        self.wfile.write(answer.body)
        self.wfile.flush()
