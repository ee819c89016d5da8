"""The server refuses other hosts and origins, wrong tokens and paths, and shows scripts in names as text."""

from __future__ import annotations

import json
import shutil
import socket
from itertools import pairwise
from pathlib import Path

import pytest

pytestmark = pytest.mark.full

SCRIPT = "<img src=x onerror=alert(1)><script>alert(2)</script>"


@pytest.fixture
def asked(workbench):
    """The status of a request with other headers."""

    def ask(path: str, method: str = "GET", body: bytes | None = None, **headers: str) -> int:
        return workbench.ask(path, method, body, **headers).status

    return ask


@pytest.mark.parametrize("host", ["evil.example", "evil.example:{port}", "127.0.0.1", "0.0.0.0:{port}", ""])
def test_another_host_is_refused(workbench, asked, host):
    assert asked(f"{workbench.path}state.json", Host=host.format(port=workbench.port)) == 403


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "https://127.0.0.1:{port}", "http://127.0.0.1:1"]
)
@pytest.mark.parametrize(
    ("method", "name"),
    [("GET", "state.json"), ("POST", "do"), ("POST", "drop?name=a.csv"), ("POST", "draft")],
)
def test_another_origin_is_refused(workbench, asked, origin, method, name):
    own = origin.format(port=workbench.port)
    assert asked(workbench.path + name, method, b'{"do": "undo"}', Origin=own) == 403


@pytest.mark.parametrize("name", ["", "state.json", "view.json", "changes", "script.js", "file?name=made"])
@pytest.mark.parametrize("token", ["/", "/x/", "//", "/{wrong}/"])
def test_request_without_the_token_is_refused(workbench, asked, token, name):
    wrong = workbench.path.strip("/")[:-1] + ("A" if workbench.path[-2] != "A" else "B")
    assert asked(token.format(wrong=wrong) + name) == 403


@pytest.mark.parametrize(
    "path",
    [
        "../../etc/passwd",
        "..%2f..%2fetc%2fpasswd",
        "state.json/../../../etc/passwd",
        "%00",
        "panel?name=../page",
    ],
)
def test_path_outside_what_is_served_is_refused(workbench, asked, path):
    assert asked(workbench.path + path) in (400, 404)


@pytest.mark.parametrize(
    "name", ["../x.csv", "..%2Fx.csv", "a%5Cb.csv", "%2Fetc%2Fx.csv", ".bashrc", "x.sh", "a%00.csv", ""]
)
def test_dropped_file_with_an_unsafe_name_is_refused(workbench, asked, name, tmp_path):
    assert asked(f"{workbench.path}drop?name={name}", "POST", b"q1\n1\n") == 400
    assert not list(tmp_path.rglob("x.csv"))


def test_server_listens_on_the_loopback_interface_only(workbench):
    own = socket.gethostbyname(socket.gethostname())
    if own.startswith("127."):
        own = next(line.split()[1] for line in _addresses() if not line.split()[1].startswith("127."))
    with pytest.raises(OSError, match="refused"):
        socket.create_connection((own, workbench.port), timeout=5)


def _addresses() -> list[str]:
    """`name address` of this machine's networks, from the kernel's list of local routes."""
    lines = Path("/proc/net/fib_trie").read_text().splitlines()
    return [f"x {before.split()[-1]}" for before, line in pairwise(lines) if "host LOCAL" in line]


@pytest.mark.parametrize(
    "body", [b"", b"[]", b"{}", b'{"do": 1}', b'{"do": "add", "candidate": "0"}', b"[" * 100000]
)
def test_malformed_action_is_refused_in_one_sentence(workbench, body):
    answer = workbench.ask(f"{workbench.path}do", "POST", body)
    said = json.loads(answer.read())
    if answer.status == 200:  # the error is found when the action runs, and shown on the page
        while (state := workbench.state())["busy"]:
            pass
        assert "expected" in state["failure"]
    else:
        assert answer.status == 400
        assert "expected" in said["error"]


def test_every_answer_forbids_foreign_scripts_and_frames(workbench):
    for name in ("", "state.json", "nothing"):
        headers = workbench.ask(workbench.path + name).headers
        assert "default-src 'none'" in headers["Content-Security-Policy"]
        assert "script-src 'self'" in headers["Content-Security-Policy"]
        assert headers["X-Frame-Options"] == "DENY"
        assert headers["Access-Control-Allow-Origin"] is None


def test_scripts_in_names_are_shown_as_text(start, browser, campaign, tmp_path):
    from bench_page import Page

    folder = tmp_path / "named"
    shutil.copytree(campaign, folder)
    robot = (folder / "robot.yaml").read_text()
    lines = [
        f"name: {json.dumps(SCRIPT)}" if line.startswith("name:") else line for line in robot.splitlines()
    ]
    (folder / "robot.yaml").write_text("\n".join(lines) + "\n")
    rows = (folder / "data.csv").read_text().splitlines()
    wide = [f"{rows[0]},<b onclick=alert(3)>", *(f"{row},1.0" for row in rows[1:])]
    data = folder / "<svg onload=alert(4)>.csv"
    data.write_text("\n".join(wide) + "\n")
    workbench = start(data, "--robot", folder / "robot.yaml", "--model", folder / "model.yaml")
    page = Page(browser, workbench.address)
    workbench.do(do="name", node=0, name=SCRIPT)
    page.until(
        lambda: SCRIPT in page.browser.run("return document.querySelector('.tree').textContent"), "name"
    )
    assert browser.run("return document.querySelector('h1').textContent") == SCRIPT
    assert browser.run(
        "return document.querySelectorAll('img, [onclick], [onload], [onerror], script:not([src])').length"
    ) in (
        0,
        browser.run("return document.querySelectorAll('script[type=\"application/json\"]').length"),
    )
    assert [line for line in browser.complaints() if "Security Policy" in line] == []
