"""The page of `sepmc studio`: its answers are those of runs, and it answers nobody else."""

import http.client
import json
import shlex
import socket
import threading
from concurrent.futures import Future
from contextlib import contextmanager

import numpy as np
import pytest
from click.testing import CliRunner
from support.browser import CHROMIUM, Page
from support.sizing_problem import FORCE, campaign, risk

import sepmc
from sepmc.cli import studio as command
from sepmc.cli.app import main
from sepmc.cli.figures import ranked_outcomes
from sepmc.scene.messages import InputError, no_log
from sepmc.studio import answers
from sepmc.studio.answers import Question, Studio
from sepmc.studio.server import Server
from sepmc.studio.sliders import available_keys, first_sliders, make_slider, moved_campaign

FACTOR = "spring.pusher.factor"
SPEED = "separation_speed_m_s"
CASES = 300


class AtOnce:
    """Executor of this process."""

    def submit(self, function, *arguments):
        future = Future()
        future.set_result(function(*arguments))
        return future


def studio_of(problem):
    return Studio(
        problem, first_sliders(problem, {}), ranked_outcomes, texts_of, AtOnce(), CASES, 1
    )


def texts_of(settings, cases, seed):
    return {"command": f"{settings} {cases} {seed}", "python": "load"}


@pytest.fixture(scope="module")
def server():
    """Server of the problem, serving."""
    with Server(studio_of(campaign())) as one:
        thread = threading.Thread(target=one.serve_forever, kwargs={"poll_interval": 0.01})
        one.studio.prepare(no_log)
        thread.start()
        yield one
        one.shutdown()
        thread.join()


def request(server, method="GET", name="", body=None, token=None, **headers):
    """Status, headers and body of an answer."""
    port = server.server_address[1]
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60.0)
    path = f"/{server.token if token is None else token}/{name}"
    connection.request(method, path, body, {k.replace("_", "-"): v for k, v in headers.items()})
    reply = connection.getresponse()
    content = reply.read()
    connection.close()
    return reply.status, reply.headers, content


def asked(server, name, **question):
    """Answer to a question."""
    status, _, content = request(server, "POST", name, json.dumps(question))
    return status, json.loads(content)


@pytest.mark.parametrize("method", ["GET", "POST", "HEAD", "PUT", "OPTIONS", "NONSENSE"])
@pytest.mark.parametrize("token", ["", "x", "%C3%A9", "../{}", "{}x"])
def test_no_answer_without_the_token(server, method, token):
    token = token.format(server.token)
    status, headers, content = request(server, method, "run", "{}", token)
    assert status == 403
    assert server.token.encode() not in content
    assert "Access-Control-Allow-Origin" not in headers


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "example.org"},
        {"Host": "127.0.0.1"},
        {"Host": "127.0.0.1:1"},
        {"Host": ""},
        {"Origin": "https://example.org"},
        {"Origin": "null"},
    ],
)
def test_no_answer_to_other_pages(server, headers):
    """A name that an attacker points to this machine, and a page from elsewhere that posts."""
    assert request(server, **headers)[0] == 403
    assert request(server, "POST", "run", "{}", **headers)[0] == 403


def test_page(server):
    """It may load nothing from elsewhere, and no other machine can connect."""
    assert server.server_address[0] == "127.0.0.1"
    assert len(server.token) >= 43
    status, headers, content = request(server)
    page = content.decode()
    assert status == 200
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert "//" not in page
    for name in ("replay.js", "figures.js", "studio.js"):
        assert f'<script src="{name}">' in page
        status, headers, content = request(server, name=name)
        assert (status, headers.get_content_type()) == (200, "text/javascript")
        assert b"https:" not in content
    host = f"localhost:{server.server_address[1]}"
    assert request(server, Host=host, Origin=f"http://{host}")[0] == 200
    assert request(server, name="secret")[0] == 404
    assert request(server, "POST", "start", "{}")[0] == 404


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("{", "truncated"),
        ('{"values": {"a": "b"}}', "float"),
        ('{"files": 1}', "files"),
        ('{"cases": 0}', "cases"),
        ('{"values": {"spring.pusher.farce": 1.0}}', "farce"),
        ('{"values": {"body.fore.mass_kg": -3.0}}', "-3"),
        ('{"spreads": {"spring.pusher.force_N": 2.0}}', "no distribution whose spread"),
    ],
)
def test_questions_that_have_no_answer(server, body, words):
    """Are refused with a reason, and the next one is answered."""
    status, _, content = request(server, "POST", "run", body)
    assert status == 400
    assert words in json.loads(content)["error"]
    assert asked(server, "slider", key=FORCE.key)[0] == 200


def test_long_questions_are_refused(server):
    assert request(server, "POST", "run", None, Content_Length="1000001")[0] == 413
    assert request(server, "POST", "run", None, Content_Length="-1")[0] == 413
    assert request(server, "POST", "run", None, Content_Length="9" * 5000)[0] == 413


def test_connections_wait():
    """As many as a browser and its tabs open at once are not reset before they are accepted."""
    with Server(studio_of(campaign())) as one:
        address = one.server_address[:2]
        connections = [socket.create_connection(address, timeout=5.0) for _ in range(40)]
        for connection in connections:
            connection.sendall(b"GET / HTTP/1.1\r\n\r\n")
        thread = threading.Thread(target=one.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        answers = [connection.recv(12) for connection in connections]
        one.shutdown()
        thread.join()
    for connection in connections:
        connection.close()
    assert answers == 40 * [b"HTTP/1.1 403"]


def test_answer_is_that_of_a_run(server):
    """Of the settings that it names, bit by bit."""
    question = {"values": {FORCE.key: 1600.0}, "spreads": {FACTOR: 1.2}, "cases": CASES, "seed": 7}
    status, answer = asked(server, "run", outcomes=[SPEED], **question)
    assert status == 200
    assert answer["settings"] == {
        FORCE.key: 1600.0,
        f"dispersion.{FACTOR}": {"normal": [1.0, pytest.approx(0.12)], "truncate_sigma": 8.0},
    }
    result = campaign().with_settings(answer["settings"]).run(CASES, 7)
    row, (drawn,) = result.statistics().loc[SPEED], answer["outcomes"].values()
    for name in ("n", "mean", "sigma", "min", "max", "p1", "p50", "p99", "case_min"):
        assert drawn[name] == row[name]
    assert drawn["bounds"] == [2.0]
    assert drawn["title"] == "separation speed (m/s)"
    rows = result.to_pandas()[SPEED]
    assert np.histogram(rows, drawn["edges"])[0].tolist() == drawn["counts"]
    (verdict,) = answer["verdicts"]
    expected = result.requirements().loc["fast"]
    assert verdict["violations"] == f"{expected['violations']} of {CASES}"
    assert verdict["verdict"] == expected["verdict"].upper()
    assert verdict["case"] == expected["worst_case"] == rows.idxmin()
    assert abs(expected["violations"] / CASES - risk(1600.0, 1.2)) < 0.08
    assert answer["counts"] == [f"{CASES} ok"]


@pytest.mark.parametrize("cases", [0, 100_001])
def test_too_few_and_too_many_cases_are_refused(cases):
    with pytest.raises(InputError, match=f"cases = {cases}: must be"):
        Studio(campaign(), [], ranked_outcomes, texts_of, AtOnce(), cases, 1)


def test_file_unchanged(server):
    """Without a move the run is that of the file, and its most important outcomes are drawn."""
    _, answer = asked(server, "run", cases=50, seed=1)
    assert answer["settings"] == {}
    assert answer["ranked"][0] == SPEED
    assert answer["outcomes"][SPEED]["mean"] == campaign().run(50, 1).statistics().at[SPEED, "mean"]


def test_case_over_time(server):
    status, (nominal, case) = asked(server, "replay", case=3, seed=2, cases=50)
    assert status == 200
    assert (nominal["number"], case["number"]) == (None, 3)
    assert case["time"][-1] == 1.0


def test_map(server, monkeypatch):
    """At the ends of two values, on the settings of the sliders."""
    monkeypatch.setattr(answers, "_GRID", (2, 2))
    axes = [(FORCE.key, 1000.0, 1600.0), ("spring.pusher.stroke_m", 0.09, 0.11)]
    status, drawn = asked(server, "map", axes=axes, cases=100, seed=2, spreads={FACTOR: 0.5})
    assert status == 200
    assert [axis["values"] for axis in drawn["axes"]] == [[1000.0, 1600.0], [0.09, 0.11]]
    changed = campaign().with_settings(
        {
            FORCE.key: 1600.0,
            "spring.pusher.stroke_m": 0.09,
            f"dispersion.{FACTOR}": {"normal": [1.0, 0.05], "truncate_sigma": 8.0},
        }
    )
    violations = changed.run(100, 2).requirements().at["fast", "violations"]
    assert 0 < violations < 100
    assert drawn["requirements"]["fast"]["fractions"][0][1] == violations / 100
    assert drawn["requirements"]["fast"]["verdicts"][0][0] == "fail"


def test_distributions_follow_values():
    """Also those that the file gives by absolute numbers; a spread is scaled about the centre."""
    dispersion = {
        FACTOR: {"uniform": [0.8, 1.2]},
        "body.fore.mass_kg": {"normal": 2.0},
        FORCE.key: {"normal": [3100.0, 50.0]},
        "body.aft.mass_kg": {"constant": 410.0},
        "initial.altitude_m": {"discrete": [0.0, 10.0]},
    }
    file = campaign().with_settings({"dispersion": dispersion})
    nominal = file.scene.body["fore"].mass
    values = {FORCE.key: 3200.0, "body.fore.mass_kg": nominal + 10.0, "body.aft.mass_kg": 450.0}
    own = file.scene.body["aft"].mass
    spreads = {FORCE.key: 2.0, FACTOR: 0.5, "body.fore.mass_kg": 1.0}
    changed, settings, notes = moved_campaign(file, values, spreads)
    assert notes == []
    assert settings == values | {
        f"dispersion.{FORCE.key}": {"normal": [3300.0, 100.0]},
        "dispersion.body.aft.mass_kg": {"constant": 410.0 + 450.0 - own},
        f"dispersion.{FACTOR}": {"uniform": [0.9, pytest.approx(1.1)]},
    }
    moved = {d.parameter.key: d.numbers for d in changed.file.dispersions}
    assert moved["body.fore.mass_kg"][:2] == (nominal + 10.0, 2.0)
    with pytest.raises(InputError, match="is discrete"):
        make_slider(file, "initial.altitude_m")
    assert [one.key for one in first_sliders(file, {})] == list(dispersion)[:-1]


def test_each_parameter_of_a_wildcard_can_have_a_slider():
    """Not only the first: a later one may be discrete."""
    (first, *_, last) = (f"body.{name}.mass_kg" for name in campaign().scene.body)
    make_slider(campaign(), "body.*.mass_kg")
    for key in (first, last):
        file = campaign().with_settings({"dispersion": {key: {"discrete": [400.0, 410.0]}}})
        with pytest.raises(InputError, match=f"{key}: cannot have a slider: its distribution is"):
            make_slider(file, "body.*.mass_kg")


def test_sliders():
    """Their ends are allowed values about the distribution; any number of the scene has one."""
    file = sepmc.load("table2")
    slider = make_slider(file, "body.upper.mass_kg")
    assert (slider.low, slider.value, slider.high) == (398.0, 458.0, 518.0)
    assert (slider.unit, slider.spread) == ("kg", "body.upper.mass_kg")
    assert slider.distribution == "uniform (438, 478)"
    assert make_slider(file, "motor.retro.thrust_N", (300.0, 700.0)).high == 700.0
    keys = available_keys(file)
    assert {"motor.retro.thrust_N", "initial.altitude_m", "body.lower.cg_mm.z"} <= set(keys)
    assert not [key for key in keys if key.startswith(("run.", "solver."))]
    for key in keys:
        one = make_slider(file, key)
        assert one.low < one.high
        assert one.low <= one.value <= one.high
    for key in ("run.cases", "solver.accuracy", "motor.retro.burn_s"):
        with pytest.raises(InputError, match="slider"):
            make_slider(file, key)
    with pytest.raises(InputError, match=r"motor\.\*\.burn_s: motor\.retro\.burn_s: cannot have"):
        make_slider(file, "motor.*.burn_s")
    inside = make_slider(file.with_settings({"environment.density_factor": 0.0}), keys[0])
    assert inside.low == 0.0


def test_settings_to_take_away(server):
    """For a run on cases that did not choose them."""
    _, texts = asked(server, "settings", values={FORCE.key: 2900.0}, cases=200, seed=3)
    assert texts["command"] == f"{ {FORCE.key: 2900.0} } 200 4"
    assert texts["python"] == "load"
    assert "force_N = 2900.0" in texts["toml"]


def test_command_line(monkeypatch):
    """Prints the address, and ends at Ctrl-C; the settings of the command line are in that of the
    page unless a slider replaces them."""
    servers = []

    @contextmanager
    def here(count):
        yield AtOnce()

    def serve(self):
        servers.append(self)
        raise KeyboardInterrupt

    monkeypatch.setattr("sepmc.processes.processes", here)
    monkeypatch.setattr(Server, "serve_forever", serve)
    monkeypatch.setattr(Studio, "prepare", lambda self, announce: None)
    given = ["--set", "body.upper.mass_kg=460", "--set", "run.end_time_s=0.4"]
    arguments = ["studio", "table2", "--no-browser", "--vary", "motor.retro.thrust_N=300:700"]
    called = CliRunner().invoke(main, [*arguments, "--vary", "body.upper.mass_kg", *given])
    assert called.exit_code == 0, called.output
    (server,) = servers
    assert server.address in called.output
    thrust, mass = server.studio.sliders
    assert (thrust.low, thrust.high, mass.value) == (300.0, 700.0, 460.0)
    values = {"body.upper.mass_kg": 465.0}
    texts = server.studio.settings(Question(values=values, seed=2019))
    assert texts["python"] == (
        "sepmc.load('table2', {'run.end_time_s': 0.4, 'body.upper.mass_kg': 465.0})"
        ".run(2000, seed=2020)"
    )
    assert shlex.split(texts["command"]) == shlex.split(
        "sepmc campaign table2 --set run.end_time_s=0.4 --set body.upper.mass_kg=465.0 "
        "--cases 2000 --seed 2020"
    )
    taken = server.server_address[1]
    with socket.socket() as other:
        other.bind(("127.0.0.1", taken))
        other.listen()
        refused = CliRunner().invoke(main, [*arguments, "--port", str(taken)])
    assert refused.exit_code == 2
    assert f"--port = {taken}: cannot be used" in refused.stderr
    for vary, message in (("a=1:2:3", "KEY=LOW:HIGH"), ("a=2:1", "LOW below HIGH")):
        refused = CliRunner().invoke(main, ["studio", "table2", "--vary", vary])
        assert refused.exit_code == 2
        assert message in refused.stderr
    assert command.studio.name == "studio"


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium")
def test_page_in_chromium(server):
    """By keyboard: a slider, its picture, a case over time, the settings to take away."""
    moved = "document.querySelector('.slider.moved') !== null"
    with Page(server.address, size=(1280, 800)) as page:

        def wait(condition):
            page.evaluate(
                f"new Promise(done => {{ const look = () => {condition} ? done() : "
                "setTimeout(look, 20); look(); })"
            )

        wait("sepmcTimes.length > 0")
        before = page.evaluate("document.querySelector('figure svg').getAttribute('aria-label')")
        assert page.text("#verdicts .verdict") in ("PASS", "FAIL", "NOT SHOWN")
        page.evaluate("document.querySelector('.slider input[type=range]').focus()")
        assert not page.evaluate(moved)
        page.key("ArrowRight")
        wait("sepmcTimes.length > 1 && !document.querySelector('#status.busy')")
        assert page.evaluate(moved)
        after = page.evaluate("document.querySelector('figure svg').getAttribute('aria-label')")
        assert before != after
        page.evaluate("document.getElementById('fly').focus()")
        page.key("Enter")
        wait("!document.getElementById('replay').hidden")
        page.click("[data-copy=toml]")
        wait("!document.getElementById('text').hidden")
        assert "[[spring]]" in page.text("#text")
        page.click("#added")
        page.type("body.fore.mass_kg")
        page.key("Enter")
        wait("document.querySelector('.slider legend').textContent.startsWith('body.fore')")
        page.click("#reset")
        wait("!document.querySelector('.slider.moved')")
        assert page.errors == []
        assert [one for one in page.requests if not one.startswith(server.address)] == []
