"""Server of the browser workstation, which answers only its own pages.

viser knows neither passwords nor origins, so a page of somebody else in the same browser could reach it on 127.0.0.1.
Each request, of a page as of a websocket, is checked before viser sees it:

- its Host names this machine itself (no foreign name that was pointed at 127.0.0.1: DNS rebinding);
- its Origin, which browsers send with every websocket, is this server's own page;
- where other machines can reach the server, it brings the token, at first in the address and then in a cookie.
"""

from __future__ import annotations

import errno
import hmac
import http
import ipaddress
import logging
import re
import secrets
import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any, TypeAlias
from urllib.parse import parse_qs, parse_qsl, urlencode, urlsplit

import rich
import viser
import websockets.asyncio.server as websocket_server
from viser import _messages
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from layflat.app.support.errors import LayflatError, UsageError

LOOPBACK = ("127.0.0.1", "::1")
_HOST = re.compile(r"(?P<name>\[[0-9a-f:.]+\]|[a-z0-9._-]+)(:\d{1,5})?")
_POLICY = (
    "default-src 'self' 'unsafe-inline' 'unsafe-eval' 'wasm-unsafe-eval' data: blob:; "
    "connect-src 'self' ws://{host} wss://{host} data: blob:; frame-ancestors 'none'; form-action 'none'"
)
_HEADERS = {
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Cache-Control": "no-store",
}
Process: TypeAlias = Callable[[ServerConnection, Request], Response | None]


@dataclass(kw_only=True)
class Guard:
    """Decides on each request before viser does."""

    token: str | None
    """What every request has to bring; None: only this machine can send any."""
    loopback: bool
    """Whether only this machine can reach the server."""
    port: int = 0
    installed: bool = field(default=False, init=False)
    """Whether a server asks this guard."""

    def refusal(self, request: Request) -> str:
        """Return why a request is refused, in one sentence, or an empty string."""
        hosts, origins = (_values(request, name) for name in ("Host", "Origin"))
        host = _HOST.fullmatch(hosts[0]) if len(hosts) == 1 else None
        if host is None or (self.loopback and not is_loopback(host["name"].strip("[]"))):
            return f"{', '.join(hosts) or 'no host'} is not an address of this server; open the address that it printed"
        own = (f"http://{hosts[0]}", f"https://{hosts[0]}")
        if len(origins) > 1 or any(origin not in own for origin in origins):
            return f"a page of {', '.join(origins)} must not use this server"
        if self.token is not None and not self._has_token(request):
            return "this server wants the token of the address that it printed; open that address"
        return ""

    def _has_token(self, request: Request) -> bool:
        """Whether the token is in the address or in the cookie; compared in a time that tells nothing."""
        cookies = [part.strip() for value in request.headers.get_all("Cookie") for part in value.split(";")]
        given = [part.partition("=")[2] for part in cookies if part.partition("=")[0] == self._cookie]
        given += parse_qs(urlsplit("//-" + request.path).query).get("token", [])
        wanted = (self.token or "").encode()
        # All are compared, so that the number of wrong ones does not show either.
        return sum(hmac.compare_digest(one.encode(errors="replace"), wanted) for one in given) > 0

    @property
    def _cookie(self) -> str:
        # A cookie belongs to all ports of a host: each server has its own.
        return f"layflat-{self.port}"

    def wrap(self, process: Process) -> Process:
        """Return viser's own answer behind this guard."""
        self.installed = True

        def guarded(connection: ServerConnection, request: Request) -> Response | None:
            why = self.refusal(request)
            if why:
                return _hardened(connection.respond(http.HTTPStatus.FORBIDDEN, why + "\n"), request)
            query = parse_qsl(request.path.partition("?")[2])
            if self.token is None or "token" not in dict(query) or _values(request, "Upgrade"):
                answer = process(connection, request)
                return None if answer is None else _hardened(answer, request)
            # The token goes from the address, which is shown and kept in the history, into a cookie.
            rest = urlencode([(name, value) for name, value in query if name != "token"])
            answer = connection.respond(http.HTTPStatus.SEE_OTHER, "")
            answer.headers["Location"] = "/" + ("?" + rest if rest else "")
            # Lax: with Strict, a link in a mail or a chat would not bring it along.
            answer.headers["Set-Cookie"] = f"{self._cookie}={self.token}; Path=/; HttpOnly; SameSite=Lax"
            return _hardened(answer, request)

        return guarded


def _values(request: Request, name: str) -> list[str]:
    return [value.strip().lower() for value in request.headers.get_all(name)]


def _hardened(answer: Response, request: Request) -> Response:
    """Return an answer that no other page can frame, embed or read."""
    host = (_values(request, "Host") or [""])[0]
    policy = _POLICY.format(host=host if _HOST.fullmatch(host) else "")
    for name, value in {**_HEADERS, "Content-Security-Policy": policy}.items():
        answer.headers[name] = value
    return answer


def is_loopback(host: str) -> bool:
    """Whether a name or an address always means this machine itself."""
    with suppress(ValueError):
        return ipaddress.ip_address(host).is_loopback
    return host.lower() == "localhost"


@dataclass(frozen=True, kw_only=True)
class SafeServer:
    """A running server and the address to open."""

    server: viser.ViserServer
    address: str


def open_server(host: str, port: int, *, token: str | None = None) -> SafeServer:
    """Serve on ``host`` and ``port`` (0: any free one); UsageError where that is impossible.

    ``token`` is made where other machines can reach the server and none is given.
    """
    if not 0 <= port < 2**16:
        raise UsageError(f"cannot serve on --host {host} --port {port}; a port is a number from 0 to 65535")
    loopback = is_loopback(host)
    if not loopback and token is None:
        token = secrets.token_urlsafe(24)
    hosts, port = _bindable(LOOPBACK if host in ("localhost", *LOOPBACK) else (host,), port)
    guard = Guard(token=token, loopback=loopback, port=port)
    # viser prints on stdout, which belongs to results, and websockets prints a traceback for each odd request.
    rich.reconfigure(quiet=True)
    logging.getLogger("websockets").setLevel(logging.CRITICAL)
    with _guarded(guard, hosts):
        server = viser.ViserServer(host=host, port=port, label="Layflat", verbose=False)
    if not guard.installed:
        server.stop()
        raise LayflatError(f"viser {viser.__version__} cannot be protected; install the version in constraints.txt")
    if server.get_port() != port:  # Somebody was faster, and viser took the next one.
        server.stop()
        raise _in_use(host, port)
    # A viewer could otherwise publish this server on the internet.
    for message in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):
        server._websock_server.unregister_handler(message)
    server.gui.configure_theme(show_share_button=False)
    return SafeServer(server=server, address=_address(host, port, token))


@contextmanager
def _guarded(guard: Guard, hosts: Sequence[str]) -> Iterator[None]:
    """Let servers that start meanwhile ask the guard first, and listen on all ``hosts``."""
    real = websocket_server.serve

    def serve(handler: Any, _host: str, port: int, *, process_request: Process, **options: Any) -> Any:
        listened: Any = list(hosts)  # asyncio takes several, and websockets hands them on.
        return real(handler, listened, port, process_request=guard.wrap(process_request), **options)

    websocket_server.serve = serve  # type: ignore[assignment,misc]
    try:
        yield
    finally:
        websocket_server.serve = real  # type: ignore[misc]


def _bindable(hosts: Sequence[str], port: int) -> tuple[list[str], int]:
    """Return the hosts on which this machine can listen (::1 is missing on some), and the port, a free one for 0."""
    found: list[str] = []
    wanted = port
    for host in hosts:
        try:
            family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)[
                0
            ]
            with socket.create_server(address, family=family) as listening:
                port = port or int(listening.getsockname()[1])
        except PermissionError as error:
            raise UsageError(f"port {port} is for the administrator; choose a --port of 1024 or more") from error
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                if found and not wanted:  # The port that was free on the first host.
                    return _bindable(hosts, 0)
                raise _in_use(host, port) from error
            if host == LOOPBACK[1] and found:
                continue
            raise UsageError(f"cannot serve on --host {host} --port {port}: {error}") from error
        found.append(host)
    return found, port


def _in_use(host: str, port: int) -> UsageError:
    return UsageError(f"port {port} of {host} is in use; choose another with --port, or end what uses it")


def _address(host: str, port: int, token: str | None) -> str:
    """Return the address to open; a server on all addresses is named by this machine's name."""
    name = socket.gethostname() if host in ("", "0.0.0.0", "::") else host
    shown = f"[{name}]" if ":" in name else name
    return f"http://{shown}:{port}/" + ("" if token is None else f"?token={token}")
