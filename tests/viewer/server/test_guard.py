"""Tests of who may ask the server."""

import pytest
from starlette.websockets import WebSocketDisconnect

from tests.viewer.server.conftest import ORIGIN, TOKEN, Server
from thalweg.viewer.server.app import FILES
from thalweg.viewer.server.guard import Guard, name_of, new_token


@pytest.mark.parametrize("name", FILES)
def test_the_pages_own_files_are_served_under_the_token(server: Server, name: str):
    answer = server.client.get(f"/{TOKEN}/{name}")
    assert (answer.status_code, answer.headers["content-type"]) == (200, FILES[name][1])
    assert "default-src 'none'" in answer.headers["content-security-policy"]
    assert answer.headers["x-content-type-options"] == "nosniff"


@pytest.mark.parametrize(
    "path",
    [
        *("/", "/page.js", "/wrong/", f"/{TOKEN}", f"/{TOKEN[:-1]}/", f"/x/{TOKEN}/", "/socket"),
        *(f"/{TOKEN}/../app.py", f"/{TOKEN}/%2e%2e/server/app.py", f"/{TOKEN}//etc/passwd", f"/{TOKEN}/page.html"),
        f"/{TOKEN}/flights/Easy-River-hand-001.npz",
    ],
)
def test_nothing_else_is_served(server: Server, path: str):
    answer = server.client.get(path)
    assert answer.status_code == 404 and "not found" in answer.text


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"host": "localhost:8765"}, 200),
        ({"host": "[::1]:8765"}, 200),
        ({"host": "localhost:9999"}, 200),  # a tunnel that ends at another port
        ({"host": "rebound.example:8765"}, 403),
        ({"host": "127.0.0.1.example:8765"}, 403),
        ({"host": ""}, 403),
        ({"host": "[:::"}, 403),
        ({"origin": ORIGIN}, 200),
        ({"origin": "http://127.0.0.1:9999"}, 403),  # another server of this machine
        ({"origin": "https://127.0.0.1:8765"}, 403),
        ({"origin": "null"}, 403),
        ({"origin": "http://evil.example"}, 403),
    ],
)
def test_foreign_hosts_and_origins_are_refused(server: Server, headers: dict, status: int):
    assert server.client.get(f"/{TOKEN}/", headers=headers).status_code == status


@pytest.mark.parametrize(
    "attempt",
    [
        {"origin": "http://evil.example"},
        {"origin": "null"},
        {"origin": None},
        {"token": "wrong"},
        {"host": "rebound.example:8765", "origin": "http://rebound.example:8765"},
    ],
)
def test_a_socket_of_a_foreign_page_is_refused(server: Server, attempt: dict):
    with pytest.raises(WebSocketDisconnect) as refused, server.open(**attempt):
        pass
    assert refused.value.code == 1008


@pytest.mark.parametrize(
    ("given", "sent", "refused"),
    [
        ("MyHost", "myhost:8000", False),
        ("2001:DB8:0::1", "[2001:db8::1]:8000", False),
        ("myhost", "MYHOST", False),
        ("myhost", "myhost.example", True),
    ],
)
def test_a_host_is_known_as_browsers_write_it(given: str, sent: str, refused: bool):
    guard = Guard(lambda *_: None, TOKEN, [given])  # pyright: ignore[reportArgumentType]
    scope = {"type": "http", "path": f"/{TOKEN}/", "headers": [(b"host", sent.encode())]}
    assert (guard.refusal(scope) is not None) == refused


def test_only_reading_is_allowed(server: Server):
    assert server.client.post(f"/{TOKEN}/", content=b"x").status_code == 405


def test_tokens_are_long_and_differ():
    assert len({new_token() for _ in range(10)}) == 10
    assert len(new_token()) >= 32


def test_the_name_of_a_host_is_read_without_port_and_brackets():
    assert [name_of(host) for host in ("[::1]:80", "localhost", "LOCALHOST:1", "")] == [
        "::1",
        "localhost",
        "localhost",
        "",
    ]
