"""Who may ask: this machine, with the token, from our own page."""

import asyncio

import pytest

from rdpi_gym.laboratory.guard import ADDRESS_NEEDED, Guard

TOKEN, PORT = "a-token", 8080
COOKIE = {"cookie": f"other=1; rdpi_lab={TOKEN}"}


async def _app(scope, receive, send):
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": b"ours"})


def ask(path="/api/state", headers=None, method="GET", query="", host=f"127.0.0.1:{PORT}"):
    """Return status, headers and body of what the guard answers."""
    sent = []

    async def send(message):
        sent.append(message)

    pairs = [(k.encode(), v.encode()) for k, v in {"host": host, **(headers or {})}.items()]
    scope = {"type": "http", "method": method, "path": path, "query_string": query.encode()}
    asyncio.run(Guard(_app, TOKEN, PORT)({**scope, "headers": pairs}, None, send))
    start, body = sent
    return start["status"], dict(start["headers"]), body["body"].decode()


def test_the_cookie_of_the_address_opens_the_door():
    status, headers, _ = ask("/", query=f"token={TOKEN}")
    assert (status, headers[b"location"]) == (303, b"/")
    cookie = headers[b"set-cookie"].decode()
    assert {"HttpOnly", "SameSite=Strict"} <= set(cookie.split("; "))
    assert ask(headers={"cookie": cookie.split(";")[0]})[0] == 200


@pytest.mark.parametrize(
    ("path", "query", "cookie"),
    [("/", "", ""), ("/", "token=other", ""), ("/api/state", "", "rdpi_lab=other"),
     ("/api/state", f"token={TOKEN}", ""), ("/lab.js", "", "")],
)  # fmt: skip
def test_without_it_there_is_one_line(path, query, cookie):
    status, _, body = ask(path, {"cookie": cookie}, query=query)
    assert (status, body.strip()) == (403, ADDRESS_NEEDED)


@pytest.mark.parametrize("host", ["evil.example", f"evil.example:{PORT}", "127.0.0.1:81", ""])
def test_a_name_that_is_pointed_at_this_machine_is_not_ours(host):
    assert ask(headers=COOKIE, host=host)[0] == 403


@pytest.mark.parametrize("origin", ["http://evil.example", "null", f"https://127.0.0.1:{PORT}"])
def test_another_page_may_not_ask(origin):
    assert ask(headers={**COOKIE, "origin": origin})[0] == 403
    assert ask(headers={**COOKIE, "origin": f"http://localhost:{PORT}"})[0] == 200


def test_a_form_of_another_page_cannot_be_sent():
    form = {**COOKIE, "content-type": "text/plain"}
    assert ask("/api/add", form, "POST")[0] == 415
    assert ask("/api/add", {**COOKIE, "content-type": "application/json"}, "POST")[0] == 200


def test_every_answer_says_that_nothing_comes_from_elsewhere():
    for status, headers, _ in (ask(), ask(headers=COOKIE)):
        assert status in (200, 403)
        assert headers[b"content-security-policy"].startswith(b"default-src 'none'; script-src")
        assert headers[b"x-content-type-options"] == b"nosniff"
        assert headers[b"cache-control"] == b"no-store"
