"""Policies of a server: openpi's protocol, chunks, forks, and servers that fail."""

from __future__ import annotations

import os
import threading
import time
from contextlib import contextmanager

import msgpack
import numpy as np
import pytest
from websockets.sync.server import serve

from layflat.app.commands.policy_server import PolicyServer, PolicyServerConfig
from layflat.app.support.errors import UsageError
from layflat.data.types import ACTION_LIMIT_M
from layflat.policy import model_io
from layflat.policy.base import PolicyError
from layflat.policy.foreign import wire
from layflat.policy.foreign.remote import RemotePolicy, parse_url
from layflat.policy.rollout import rollout
from layflat.policy.spec import PolicySpec
from layflat.sim.config import SimConfig
from layflat.tests.fake_environment import FakeEnvironment
from layflat.tests.policy.factories import gp_model


def env(robot="hanger") -> FakeEnvironment:
    made = FakeEnvironment(SimConfig(robot=robot))
    made.reset(0)
    return made


@contextmanager
def running(server, run):
    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        yield server
    finally:
        server.shutdown() if hasattr(server, "shutdown") else server.close()
        thread.join(5)


@contextmanager
def foreign_server(answer, metadata=b"\x80"):
    """A server in the manner of openpi's: ``answer(message, number)`` gives what is sent, of any kind."""
    seen: list[dict] = []

    def handle(connection):
        connection.send(metadata)
        for data in connection:
            seen.append(wire.unpack(data))
            sent = answer(seen[-1], len(seen))
            if sent is None:
                return
            connection.send(sent if isinstance(sent, (bytes, str)) else wire.pack(sent))

    server = serve(handle, "127.0.0.1", 0)
    with running(server, server.serve_forever):
        yield f"ws://127.0.0.1:{server.socket.getsockname()[1]}", seen


@contextmanager
def served(policy: str):
    server = PolicyServer(PolicyServerConfig(policy=policy, port=0))
    with running(server, server.run):
        yield f"ws://127.0.0.1:{server.port}"


def test_observations_are_sent_as_the_session_file_names_them():
    with foreign_server(lambda message, number: {"actions": np.zeros((1, 2), np.float32)}) as (url, seen):
        rollout(env(), PolicySpec.parse(url), seed=7, max_steps=2)
    first, second = seen
    assert {name: first[name].shape for name in ("time_s", "corner_positions", "holder_position", "word")} == {
        "time_s": (1,),
        "corner_positions": (6,),
        "holder_position": (3,),
        "word": (2,),
    }
    assert [first[key] for key in ("robot", "task", "cloth", "seed", "step")] == ["hanger", "place", "towel", 7, 0]
    assert (first["prompt"], second["step"]) == (wire.PROMPT, 1)


@pytest.mark.parametrize(
    ("suffix", "asked"), [("", 2), ("?replan=2", 3), ("?replan=1", 5)], ids=["all", "two of three", "each step"]
)
def test_a_chunk_is_carried_out_up_to_the_replan_horizon(suffix, asked):
    def answer(message, number):
        return {"actions": np.tile(number * 0.1 + np.arange(3)[:, None] * 0.01, 2)}

    with foreign_server(answer) as (url, seen):
        episode = rollout(env(), PolicySpec.parse(f"vla={url}{suffix}"), seed=0, max_steps=5)
    length = {2: 3, 3: 2, 5: 1}[asked]
    expected = [(step // length + 1) * 0.1 + step % length * 0.01 for step in range(5)]
    assert len(seen) == asked
    assert [step.action[0] for step in episode.steps] == pytest.approx(np.array(expected) * ACTION_LIMIT_M)


def test_what_was_planned_is_dropped_after_a_disturbance():
    with foreign_server(lambda message, number: {"actions": np.full((50, 2), 0.1)}) as (url, seen):
        rollout(env(), PolicySpec.parse(url), seed=0, disturbance="push", max_steps=3)
    assert [message["resumed"] for message in seen][:2] == [False, True]


@pytest.mark.parametrize(
    "policy", ["MODEL", "MODEL+recovery+steady", "random", "hold", "MODEL+drag-rule"], ids=str.lower
)
def test_a_served_policy_gives_the_same_episode_to_the_bit(policy, tmp_path):
    model_io.save(gp_model(), tmp_path / "model.npz")
    policy = policy.replace("MODEL", str(tmp_path / "model.npz"))
    here = rollout(env(), PolicySpec.parse(policy), seed=5, disturbance="push", max_steps=12)
    with served(policy) as url:
        there = rollout(env(), PolicySpec.parse(url), seed=5, disturbance="push", max_steps=12)
    assert len(here.steps) == len(there.steps)
    for mine, theirs in zip(here.steps, there.steps, strict=True):
        assert np.array_equal(mine.action, theirs.action)
        assert (mine.action_std is None) == (theirs.action_std is None)
    assert here.stopped_by == there.stopped_by


def test_a_fork_in_the_middle_of_an_episode_goes_on_with_its_own_connection():
    """A random policy has a state: the fork only agrees where the server got the episode once more."""
    with served("random") as url:
        policy = PolicySpec.parse(url).make(env())
        policy.reset(3)
        observation = env().observe()
        before = [policy.act(observation).action for _ in range(3)]
        read, write = os.pipe()
        if not (child := os.fork()):
            try:
                os.write(write, policy.act(observation).action.tobytes())
            finally:
                os._exit(0)
        os.waitpid(child, 0)
        assert np.array_equal(np.frombuffer(os.read(read, 1000)), policy.act(observation).action)
        assert len(before) == 3


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (lambda *_: {"action": 1}, r"answers without actions; its keys are \['action'\]"),
        (lambda *_: {"actions": np.zeros((4, 7))}, r"actions of shape \(4, 7\); hanger needs \(T, 2\)"),
        (lambda *_: {"actions": np.zeros((0, 2))}, r"shape \(0, 2\)"),
        (lambda *_: {"actions": np.array([[0.0, np.inf]])}, "not finite numbers, in step 1"),
        (lambda *_: {"actions": np.zeros(2), "stop": "bored"}, "stops by 'bored'"),
        (lambda *_: b"\xc1nonsense", "not msgpack"),
        (lambda *_: msgpack.packb([1, 2]), "a message is a list"),
        (lambda *_: "Traceback ...\n  File x\nRuntimeError: out of memory\n", "reports: RuntimeError: out of memory"),
        (lambda *_: None, "has closed the connection"),
        (lambda *_: time.sleep(1), "has not answered for 0.2 s"),
    ],
)
def test_a_server_that_fails_is_one_sentence(answer, words):
    with foreign_server(answer) as (url, _):
        policy = PolicySpec.parse(f"{url}?timeout=0.2").make(env())
        policy.reset(0)
        with pytest.raises(PolicyError, match=words) as caught:
            policy.act(env().observe())
    assert "\n" not in str(caught.value)


def test_an_address_where_nothing_or_something_else_answers_is_one_sentence():
    with pytest.raises(PolicyError, match=r"no policy server answers at ws://127\.0\.0\.1:9: "):
        PolicySpec.parse("ws://127.0.0.1:9").make(env())
    with (
        foreign_server(lambda *_: None, metadata="hello") as (url, _),
        pytest.raises(PolicyError, match="reports: hello"),
    ):
        RemotePolicy(url, env().spec, "x")


@pytest.mark.parametrize("url", ["ws://", "ws://host", "ws://host:99999", "ws://h:1?replan=x", "ws://h:1?speed=2"])
def test_an_address_that_is_none_is_refused(url):
    with pytest.raises(PolicyError, match="is no address; it must be ws://HOST:PORT"):
        parse_url(url)


def test_arrays_and_numbers_survive_the_wire_and_objects_do_not():
    sent = {"a": np.arange(6, dtype=">i2").reshape(2, 3), "b": np.float32(0.1), "c": [True, None, "x", 2]}
    got = wire.unpack(wire.pack(sent))
    assert np.array_equal(got["a"], sent["a"])
    assert got["a"].dtype == sent["a"].dtype
    assert got["b"] == sent["b"]
    assert got["b"].dtype == np.float32
    assert got["c"] == sent["c"]
    with pytest.raises(TypeError, match="cannot be sent"):
        wire.pack({"a": np.array([object()])})
    with pytest.raises(PolicyError, match="not msgpack"):
        wire.unpack(msgpack.packb({b"__ndarray__": True}))
    hostile = msgpack.packb({b"__ndarray__": True, b"data": b"12345678", b"dtype": "|O", b"shape": [1]})
    with pytest.raises(PolicyError, match="not taken"):
        wire.unpack(hostile)


@pytest.mark.parametrize(("key", "value"), [("word", None), ("word", [1.0]), ("contact_portion", "much")])
def test_an_observation_that_is_none_is_refused(key, value):
    message = wire.encode_observation(env().observe(), images=False)
    message.pop(key) if value is None else message.update({key: value})
    with pytest.raises(PolicyError, match="the observation"):
        wire.decode_observation(message)


def test_the_server_answers_its_health_refuses_browsers_and_keeps_running():
    import urllib.request

    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect

    with served("hold") as url:
        with urllib.request.urlopen(url.replace("ws:", "http:") + "/healthz", timeout=5) as page:
            assert page.status == 200
        with pytest.raises(InvalidStatus, match="403"):
            connect(url, origin="https://evil.example")
        with connect(url) as wrong:
            wrong.recv()
            wrong.send(wire.pack({"step": 0}))
            assert "needs robot" in wrong.recv()
        with connect(url) as wrong:
            wrong.recv()
            wrong.send(wire.pack({"step": 0, "robot": "hanger", "seed": "seven"}))
            assert "seven" in wrong.recv()
        assert len(rollout(env(), PolicySpec.parse(url), seed=0, max_steps=2).steps) == 2


def test_metadata_that_make_no_sense_are_one_sentence():
    with (
        foreign_server(lambda *_: None, metadata=wire.pack({"max_extra_steps": "many"})) as (url, _),
        pytest.raises(PolicyError, match="max_extra_steps 'many'; it must be a whole number"),
    ):
        RemotePolicy(url, env().spec, "x")


def test_a_policy_that_needs_the_mesh_cannot_be_served():
    with pytest.raises(UsageError, match="looks at the mesh"):
        PolicyServer(PolicyServerConfig(policy="scripted", port=0))
