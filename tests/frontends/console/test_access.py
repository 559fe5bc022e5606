import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.frontends.console.access import Access, Gate, RefusedError, checked_host

HOST = "127.0.0.1:4000"
ORIGIN = f"http://{HOST}"
GATE = Gate("127.0.0.1", 4000, {Access.CONTROL: "secret", Access.READ_ONLY: "look"})


def test_a_token_says_what_its_address_allows():
    assert GATE.address(Access.CONTROL) == "http://127.0.0.1:4000/secret/"
    assert GATE.admit("/secret/", [HOST], [], is_socket=False) == (Access.CONTROL, "")
    assert GATE.admit("/look/page.js?x=1", [HOST], [ORIGIN], is_socket=False) == (Access.READ_ONLY, "page.js")
    assert GATE.admit("/secret/console", [HOST], [ORIGIN], is_socket=True) == (Access.CONTROL, "console")


@pytest.mark.parametrize("path", ["/", "", "/secre/", "/secrets/", "//secret/", "/../secret/", "/?token=secret", "/é/"])
def test_without_a_token_nothing_is_served(path):
    with pytest.raises(RefusedError, match="not found"):
        GATE.admit(path, [HOST], [ORIGIN], is_socket=False)


@pytest.mark.parametrize("is_socket", [False, True])
@pytest.mark.parametrize(
    ("hosts", "origins"),
    [
        (["evil.example"], ["http://evil.example"]),  # a name that points here: equal to one another, not to ours
        (["localhost:4000"], ["http://localhost:4000"]),
        (["127.0.0.1"], [ORIGIN]),
        ([], [ORIGIN]),
        ([HOST, HOST], [ORIGIN]),
        ([HOST], ["http://evil.example"]),
        ([HOST], ["https://127.0.0.1:4000"]),
        ([HOST], ["null"]),
        ([HOST], [ORIGIN, "http://evil.example"]),
    ],
)
def test_another_host_or_origin_is_refused(hosts, origins, is_socket):
    with pytest.raises(RefusedError, match="is not the printed address"):
        GATE.admit("/secret/", hosts, origins, is_socket=is_socket)


def test_a_socket_needs_an_origin():
    with pytest.raises(RefusedError, match="Origin is not the printed address"):
        GATE.admit("/secret/console", [HOST], [], is_socket=True)


def test_tokens_are_long_and_new_each_time():
    tokens = {token for _ in range(10) for token in Gate("127.0.0.1", 1).tokens.values()}
    assert len(tokens) == 20
    assert all(len(token) == 32 for token in tokens)


def test_addresses_are_spelled_as_browsers_do():
    assert Gate("::1", 4000).origin == "http://[::1]:4000"
    assert Gate("10.0.0.2", 80).authority == "10.0.0.2"


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "224.0.0.1", "robot.local", ""])
def test_a_host_that_is_no_one_address_is_refused(host):
    with pytest.raises(InputError, match="--host: is "):
        checked_host(host)
    assert checked_host("192.168.1.20") == "192.168.1.20"
