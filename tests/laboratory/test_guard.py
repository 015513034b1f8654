"""Who may ask: this machine, with the token, from our own page."""

import asyncio
import json

from rdpi_gym.laboratory.server import ADDRESS_NEEDED, TICKET_USED, Guard
from tests.looping import over

TOKEN, TICKET, PORT = "a-token", "a-ticket", 8080
OURS = {"authorization": f"Bearer {TOKEN}"}


async def _app(scope, receive, send):
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": b"ours"})


def guarded():
    return Guard(_app, TOKEN, TICKET, PORT, {"/", "/api.js"})


def ask(path="/api/state", headers=None, method="GET", host=f"127.0.0.1:{PORT}", guard=None):
    """Return status, headers and body of what the guard answers."""
    sent = []

    async def send(message):
        sent.append(message)

    pairs = [(k.encode(), v.encode()) for k, v in {"host": host, **(headers or {})}.items()]
    scope = {"type": "http", "method": method, "path": path, "query_string": b""}
    asyncio.run((guard or guarded())({**scope, "headers": pairs}, None, send))
    start, body = sent
    return start["status"], dict(start["headers"]), body["body"].decode()


def test_the_token_opens_the_session():
    assert ask(headers=OURS)[0] == 200


@over(
    "headers",
    [
        {},
        {"authorization": "Bearer other"},
        {"authorization": f"Ticket {TICKET}"},
        {"cookie": f"rdpi_lab={TOKEN}"},
        {"authorization": TOKEN},
    ],
)
@over("path", ["/api/state", "/api/take/model.json", "/api/files/run.csv", "/other"])
def test_without_it_there_is_one_line(path, headers):
    status, _, body = ask(path, headers)
    assert (status, body.strip()) == (403, ADDRESS_NEEDED)


def test_the_page_itself_is_no_secret():
    assert [ask(path)[0] for path in ("/", "/api.js")] == [200, 200]


def test_the_ticket_of_a_browser_gives_the_token_once():
    guard, ticket = guarded(), {"authorization": f"Ticket {TICKET}"}
    status, _, body = ask("/api/token", ticket, guard=guard)
    assert (status, json.loads(body)) == (200, {"token": TOKEN})
    status, _, body = ask("/api/token", ticket, guard=guard)
    assert (status, json.loads(body)) == (403, {"problem": TICKET_USED})


@over("given", ["", "Ticket ", "Ticket other", f"Bearer {TOKEN}"])
def test_no_other_word_gives_it(given):
    assert ask("/api/token", {"authorization": given})[0] == 403


def test_no_secret_is_kept_where_other_servers_of_this_machine_receive_it():
    for path, headers in (
        ("/", {}),
        ("/", OURS),
        ("/api/token", {"authorization": f"Ticket {TICKET}"}),
    ):
        assert b"set-cookie" not in ask(path, headers)[1]


@over("host", ["evil.example", f"evil.example:{PORT}", "127.0.0.1:81", ""])
def test_a_name_that_is_pointed_at_this_machine_is_not_ours(host):
    assert ask(headers=OURS, host=host)[0] == 403


@over("origin", ["http://evil.example", "null", f"https://127.0.0.1:{PORT}"])
def test_another_page_may_not_ask(origin):
    assert ask(headers={**OURS, "origin": origin})[0] == 403
    assert ask(headers={**OURS, "origin": f"http://localhost:{PORT}"})[0] == 200


def test_a_form_of_another_page_cannot_be_sent():
    form = {**OURS, "content-type": "text/plain"}
    assert ask("/api/add", form, "POST")[0] == 415
    assert ask("/api/add", {**OURS, "content-type": "application/json"}, "POST")[0] == 200


def test_every_answer_says_that_nothing_comes_from_elsewhere():
    for status, headers, _ in (ask(), ask(headers=OURS)):
        assert status in (200, 403)
        assert headers[b"content-security-policy"].startswith(b"default-src 'none'; script-src")
        assert headers[b"x-content-type-options"] == b"nosniff"
        assert headers[b"cache-control"] == b"no-store"
