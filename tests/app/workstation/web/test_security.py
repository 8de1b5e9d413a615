"""The browser workstation's server, asked by real HTTP and websocket clients: what it refuses and what it answers."""

from __future__ import annotations

import http.client
import io
import socket
import sys
from collections.abc import Iterator
from contextlib import redirect_stdout

import pytest

viser = pytest.importorskip("viser")

from viser import _messages  # noqa: E402
from websockets.exceptions import InvalidStatus  # noqa: E402
from websockets.sync.client import connect  # noqa: E402

from layflat.app.support.errors import UsageError  # noqa: E402
from layflat.app.workstation.web.security import Guard, SafeServer, is_loopback, open_server  # noqa: E402

TOKEN = "s3cret-of-this-test"


def ipv6() -> bool:
    try:
        socket.create_server(("::1", 0), family=socket.AF_INET6).close()
    except OSError:
        return False
    return True


@pytest.fixture(scope="module")
def local() -> Iterator[SafeServer]:
    served = open_server("127.0.0.1", 0)
    yield served
    served.server.stop()


@pytest.fixture(scope="module")
def remote() -> Iterator[SafeServer]:
    served = open_server("0.0.0.0", 0, token=TOKEN)
    yield served
    served.server.stop()


def get(served: SafeServer, path: str = "/", to: str = "127.0.0.1", **headers: str | None) -> http.client.HTTPResponse:
    """Answer to a GET with these headers; None leaves one out, ``cookie_`` names one of several words."""
    port = served.server.get_port()
    connection = http.client.HTTPConnection(to, port, timeout=5)
    connection.putrequest("GET", path, skip_host=True)
    for name, value in {"host": f"127.0.0.1:{port}", **headers}.items():
        if value is not None:
            connection.putheader(name, value.format(port=port))
    connection.endheaders()
    return connection.getresponse()


def websocket_status(served: SafeServer, path: str = "/", to: str = "127.0.0.1", **headers: str) -> int:
    """Status of a websocket's handshake (101: accepted) with a Host, an Origin and a Cookie of one's own."""
    port = served.server.get_port()
    host = headers.pop("host", f"127.0.0.1:{port}").format(port=port)
    origin = headers.pop("origin", "").format(port=port) or None
    sock = socket.create_connection((to, port), timeout=5)
    try:
        with connect(
            f"ws://{host}{path}",
            sock=sock,
            origin=origin,  # type: ignore[arg-type]
            additional_headers=headers,
            subprotocols=[f"viser-v{viser.__version__}"],  # type: ignore[list-item]
            open_timeout=5,
            max_size=None,
        ) as opened:
            # viser's first message shows that it really serves this client.
            assert isinstance(opened.recv(timeout=5), bytes)
            return 101
    except InvalidStatus as error:
        return int(error.response.status_code)


OWN = ["127.0.0.1:{port}", "localhost:{port}", "[::1]:{port}", "localhost:9999", "127.0.0.1:9999", "localhost"]
"""What a browser on this machine calls the server; another port is that of `ssh -L`."""


@pytest.mark.parametrize("host", OWN)
def test_own_pages_are_served(local: SafeServer, host: str) -> None:
    page = get(local, host=host)
    assert page.status == 200
    assert b"<html" in page.read()
    assert websocket_status(local, host=host, origin=f"http://{host}") == 101


def test_a_program_of_this_machine_needs_no_origin(local: SafeServer) -> None:
    assert websocket_status(local) == 101


@pytest.mark.skipif(not ipv6(), reason="this machine has no ::1")
def test_it_listens_on_both_loopback_addresses(local: SafeServer) -> None:
    assert get(local, to="::1", host="[::1]:{port}").status == 200
    assert websocket_status(local, to="::1", host="[::1]:{port}", origin="http://[::1]:{port}") == 101


FOREIGN = [
    "http://evil.example",
    "https://evil.example",
    "http://evil.example:{port}",
    "http://localhost:3000",
    "http://127.0.0.1",
    "http://127.0.0.1.evil.example:{port}",
    "http://localhost:{port}",
    "null",
    "file://",
    "chrome-extension://abc",
]


@pytest.mark.parametrize("origin", FOREIGN)
def test_a_foreign_page_is_refused_on_loopback(local: SafeServer, origin: str) -> None:
    assert websocket_status(local, origin=origin) == 403
    answer = get(local, origin=origin)
    assert answer.status == 403
    assert b"must not use this server" in answer.read()


@pytest.mark.parametrize("host", ["evil.example", "evil.example:{port}", "127.0.0.1.evil.example", "10.0.0.7:{port}"])
def test_a_foreign_name_for_this_machine_is_refused(local: SafeServer, host: str) -> None:
    """DNS rebinding: page and websocket have the same origin, which the attacker's name server points to 127.0.0.1."""
    assert websocket_status(local, host=host, origin=f"http://{host}") == 403
    assert get(local, host=host).status == 403


@pytest.mark.parametrize("host", [None, "", "localhost:{port}, evil.example", "user@localhost", "local host", "a/b"])
def test_a_request_without_a_proper_host_is_refused(local: SafeServer, host: str | None) -> None:
    assert get(local, host=host).status == 403


def test_two_hosts_or_origins_are_refused(local: SafeServer) -> None:
    for twice in (b"Host: localhost\r\nHost: evil.example", b"Host: localhost\r\nHost: localhost",
                  b"Host: localhost\r\nOrigin: http://localhost\r\nOrigin: http://evil.example"):  # fmt: skip
        with socket.create_connection(("127.0.0.1", local.server.get_port()), timeout=5) as raw:
            raw.sendall(b"GET / HTTP/1.1\r\n" + twice + b"\r\n\r\n")
            assert raw.recv(64).startswith(b"HTTP/1.1 403")


def test_no_page_can_frame_embed_or_cache_it(local: SafeServer) -> None:
    headers = get(local).headers
    assert headers["X-Frame-Options"] == "DENY"
    assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
    assert f"ws://127.0.0.1:{local.server.get_port()}" in headers["Content-Security-Policy"]
    assert headers["Cross-Origin-Resource-Policy"] == "same-origin"
    assert headers["Cache-Control"] == "no-store"


@pytest.mark.parametrize("path", ["/../security.py", "/%2e%2e/%2e%2e/_viser.py", "//etc/passwd", "/..\\.._viser.py"])
def test_no_file_beside_the_page_is_served(local: SafeServer, path: str) -> None:
    assert get(local, path).status == 404


def test_the_token_is_wanted_where_other_machines_reach_it(remote: SafeServer) -> None:
    for path in ("/", "/?token=", "/?token=wrong", f"/?token={TOKEN}x", f"/?token={TOKEN[:-1]}", f"/{TOKEN}"):
        answer = get(remote, path)
        assert answer.status == 403
        assert TOKEN.encode() not in answer.read()
        assert answer.headers["Set-Cookie"] is None
        assert websocket_status(remote, path) == 403
    for cookie in ("layflat-{port}=wrong", "layflat-1=" + TOKEN, "layflat-{port}=", TOKEN, "xlayflat-{port}=" + TOKEN):
        named = cookie.format(port=remote.server.get_port())
        assert get(remote, cookie=named).status == 403
        assert websocket_status(remote, cookie=named) == 403
    # This machine needs it, too: every user of it reaches the server.
    assert get(remote, host="localhost:{port}").status == 403


def test_the_token_moves_from_the_address_into_a_cookie(remote: SafeServer) -> None:
    first = get(remote, f"//evil.example/?token={TOKEN}&darkMode=", host="robot.lab:{port}")
    assert (first.status, first.headers["Location"]) == (303, "/")
    first = get(remote, f"/?token={TOKEN}&darkMode=1", host="robot.lab:{port}")
    assert (first.status, first.headers["Location"]) == (303, "/?darkMode=1")
    cookie = first.headers["Set-Cookie"]
    assert {"HttpOnly", "SameSite=Lax", "Path=/"} <= {part.strip() for part in cookie.split(";")}
    kept = "theme=dark; " + cookie.partition(";")[0]
    assert get(remote, host="robot.lab:{port}", cookie=kept).status == 200
    host = "robot.lab:{port}"
    assert websocket_status(remote, host=host, origin=f"http://{host}", cookie=kept) == 101


def test_a_program_brings_the_token_in_its_address(remote: SafeServer) -> None:
    assert websocket_status(remote, f"/?token={TOKEN}") == 101


def test_a_foreign_page_is_refused_with_the_cookie_of_the_browser(remote: SafeServer) -> None:
    cookie = f"layflat-{remote.server.get_port()}={TOKEN}"
    assert websocket_status(remote, cookie=cookie, origin="http://evil.example") == 403
    assert get(remote, cookie=cookie, origin="http://evil.example").status == 403


def test_an_address_is_printed_with_a_token_of_its_own() -> None:
    served = [open_server("0.0.0.0", 0) for _ in range(2)]
    try:
        tokens = [one.address.partition("/?token=")[2] for one in served]
        assert len(set(tokens)) == 2
        assert min(map(len, tokens)) >= 32
        assert f":{served[0].server.get_port()}/" in served[0].address
    finally:
        for one in served:
            one.server.stop()


def test_the_local_address_has_no_token(local: SafeServer) -> None:
    assert local.address == f"http://127.0.0.1:{local.server.get_port()}/"


def test_a_port_in_use_is_said_and_no_other_is_taken() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(UsageError, match=rf"port {port} of 127.0.0.1 is in use; choose another with --port"):
            open_server("127.0.0.1", port)


@pytest.mark.parametrize(
    ("host", "port"), [("192.0.2.1", 0), ("no such name", 0), ("127.0.0.1", 70000), ("127.0.0.1", -1)]
)
def test_an_impossible_address_is_one_sentence(host: str, port: int) -> None:
    with pytest.raises(UsageError, match="cannot serve on --host"):
        open_server(host, port)


def test_no_viewer_can_publish_it(local: SafeServer) -> None:
    handled = local.server._websock_server._incoming_handlers
    assert _messages.ShareUrlRequest not in handled
    assert _messages.ShareUrlDisconnect not in handled


def test_nothing_is_printed() -> None:
    said = io.StringIO()
    with redirect_stdout(said):
        open_server("127.0.0.1", 0).server.stop()
    assert said.getvalue() == ""
    sys.stdout.flush()


@pytest.mark.parametrize(
    ("host", "is_it"),
    [("127.0.0.1", True), ("127.8.8.8", True), ("::1", True), ("localhost", True), ("LOCALHOST", True),
     ("0.0.0.0", False), ("::", False), ("192.168.0.2", False), ("localhost.evil.example", False), ("", False)],
)  # fmt: skip
def test_loopback_is_this_machine_only(host: str, is_it: bool) -> None:
    assert is_loopback(host) is is_it


def test_a_guard_that_viser_does_not_ask_ends_the_server(monkeypatch: pytest.MonkeyPatch) -> None:
    """Another version of viser may start its server in another way: then nothing is served."""
    monkeypatch.setattr(Guard, "wrap", lambda self, process: process)
    with pytest.raises(Exception, match="cannot be protected"):
        open_server("127.0.0.1", 0)
