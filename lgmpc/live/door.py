"""A door in front of the page for other machines: it lets in those whose address has the token.

viser has no access control. Here it listens on this machine alone, and this server, on the address that others can
reach, passes on the connections of browsers that opened the page with its token, which a cookie remembers. The traffic
is not encrypted: over a network that others listen to, an ssh tunnel is better.
"""

from __future__ import annotations

import asyncio
import hmac
import threading
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs, urlsplit

__all__ = ["open_door"]

_COOKIE = "lgmpc_live"
_LONGEST = 16384


def _response(status: str, *fields: str, body: str = "") -> bytes:
    lines = (f"HTTP/1.1 {status}", *fields, f"Content-Length: {len(body)}", "Connection: close", "", body)
    return "\r\n".join(lines).encode()


_REFUSED = _response("403 Forbidden", "Content-Type: text/plain", body="Open the page with its ?token=.\n")


def open_door(host: str, port: int, inside: int, token: str) -> None:
    """Serve at ``host:port``, in a thread, what is served at port ``inside`` of this machine, for those with a token.

    Raises:
        OSError: the address cannot be listened at.
    """
    opened: asyncio.AbstractEventLoop = asyncio.new_event_loop()

    async def admit(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            head = await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), 10.0)
            answer = _answer(head, token)
            if answer:
                writer.write(answer)
                await writer.drain()
            else:
                await _pass_on(head, reader, writer, inside)
        except (OSError, asyncio.IncompleteReadError, asyncio.LimitOverrunError, asyncio.TimeoutError):
            pass
        finally:
            writer.close()

    server = asyncio.start_server(admit, host, port, limit=_LONGEST)
    opened.run_until_complete(server)
    threading.Thread(target=opened.run_forever, daemon=True).start()


def _answer(head: bytes, token: str) -> bytes:
    """Return the answer to a request without passing it on; nothing for one that may pass."""
    request, *lines = head.decode("latin-1").split("\r\n")
    fields = {name.strip().lower(): value.strip() for name, _, value in (line.partition(":") for line in lines)}
    target = request.split(" ")[1] if request.count(" ") == 2 else ""
    if _same(parse_qs(urlsplit(target).query).get("token", [""])[0], token):
        cookie = f"{_COOKIE}={token}; HttpOnly; SameSite=Strict; Path=/"
        return _response("303 See Other", "Location: /", f"Set-Cookie: {cookie}")
    try:
        cookies = SimpleCookie(fields.get("cookie", ""))
    except CookieError:
        return _REFUSED
    return b"" if _COOKIE in cookies and _same(cookies[_COOKIE].value, token) else _REFUSED


def _same(given: str, token: str) -> bool:
    return hmac.compare_digest(given.encode(), token.encode())


async def _pass_on(head: bytes, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, inside: int) -> None:
    """Connect a client with the server inside until one of them closes; that one closes after each page."""
    into, out = await asyncio.open_connection("127.0.0.1", inside)
    out.write(head)
    await asyncio.gather(_copy(reader, out), _copy(into, writer))


async def _copy(source: asyncio.StreamReader, to: asyncio.StreamWriter) -> None:
    try:
        while data := await source.read(1 << 16):
            to.write(data)
            await to.drain()
    finally:
        to.close()
