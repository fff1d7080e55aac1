"""Connections that never finish their headers, and numbers of any length, don't stop the server."""

import contextlib
import http.client
import socket
import threading
import time

import pytest

pytest.importorskip("uvicorn", reason="extra `web` is not installed")

from socialiq.view import server


def test_silent_connections_are_closed_and_overlong_numbers_are_no_fault(monkeypatch):
    monkeypatch.setattr(server, "HEADER_SECONDS", 1.0)
    addresses = []
    opened = threading.Event()

    def take(address):
        addresses.append(address)
        opened.set()

    threading.Thread(target=server.serve, args=(None, 0, take), daemon=True).start()
    opened.wait()
    host, token = addresses[0].split("/")[2:4]
    name, port = host.split(":")

    def status(path):
        connection = http.client.HTTPConnection(name, int(port))
        with contextlib.closing(connection):
            connection.request("GET", f"/{token}{path}")
            with connection.getresponse() as response:
                return response.status

    assert status("/") == 200
    for number in ("9" * 5000, "x", "-1", "٣".encode().hex(), "3"):
        assert status(f"/part/{number}") == 404
    silent = [socket.create_connection((name, int(port))) for _ in range(70)]
    for connection in silent:
        connection.sendall(b"GET / HTTP/1.1\r\n")
    while status("/") != 200:
        time.sleep(0.1)
    for connection in silent:
        connection.close()
