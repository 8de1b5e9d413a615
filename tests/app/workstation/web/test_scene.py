"""The browser's scene, as a real server sends it: what is shown, what a drag gives, what a frame costs on the line."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("viser")

from layflat.app.media import cloth_colors as colors
from layflat.app.workstation.preview import initial_frame
from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.app.workstation.web.scene import LOWEST_TARGET_M, Scene, landing
from layflat.app.workstation.web.security import SafeServer, open_server
from layflat.app.workstation.web.stage import VIEWS, add_stage
from layflat.data.types import DragTarget
from layflat.sim.cloth.registry import cloth_spec

FRAME_BYTES = 30_000
"""Most that a frame may send: at 20 frames a second, 0.6 MB/s."""


@pytest.fixture(scope="module")
def served() -> Iterator[SafeServer]:
    safe = open_server("127.0.0.1", 0)
    add_stage(safe.server)
    yield safe
    safe.server.stop()


def node(served: SafeServer, name: str) -> Any:
    handle = served.server.scene.get_handle_by_name(name)
    assert handle is not None, name
    return handle


def laid(frame: SimulationFrame, **values: Any) -> SimulationFrame:
    return replace(frame, nodes=cloth_spec(frame.cloth).flat_nodes(), step=9, **values)


@pytest.fixture
def scene(served: SafeServer) -> Iterator[Scene]:
    made = Scene(served.server.scene)
    yield made
    made.remove()


@pytest.mark.parametrize(("robot", "cloth"), [("hanger", "towel"), ("pickers", "napkin")])
def test_the_cloth_is_checked_on_its_face_and_plain_on_its_reverse(
    served: SafeServer, scene: Scene, robot: str, cloth: str
) -> None:
    frame = initial_frame(robot, cloth)
    scene.show(frame)
    face, check, reverse = (node(served, f"/bench/cloth/{name}") for name in ("face", "check", "reverse"))
    assert [tuple(part.color) for part in (face, check, reverse)] == [colors.FACE, colors.FACE_CHECK, colors.REVERSE]
    assert [part.side for part in (face, check, reverse)] == ["front", "front", "back"]
    assert len(face.faces) + len(check.faces) == len(reverse.faces)
    # The nodes are vertices of the surface, wherever they are.
    for point in frame.nodes[::17]:
        assert np.linalg.norm(reverse.vertices - point, axis=1).min() < 1e-6


def test_contact_and_shadow_follow_the_cloth(served: SafeServer, scene: Scene) -> None:
    frame = initial_frame("hanger", "towel")
    scene.show(frame)
    contact, shadow = (node(served, f"/bench/cloth/{name}") for name in ("contact", "shadow"))
    assert len(contact.faces) == 0
    np.testing.assert_allclose(shadow.vertices[:, :2], frame.nodes[:, :2], atol=1e-6)
    assert shadow.vertices[:, 2].max() < 0
    scene.show(laid(frame))
    assert len(contact.faces) == len(cloth_spec("towel").triangles())


def test_a_fold_is_marked_and_a_flat_cloth_is_not(served: SafeServer, scene: Scene) -> None:
    frame = laid(initial_frame("hanger", "towel"))
    scene.show(frame)
    line = node(served, "/bench/cloth/fold")
    assert len(line.points) == 0
    nodes = frame.nodes.copy()
    turned = nodes[:, 0] < 0.1
    nodes[turned, 0] = 0.2 - nodes[turned, 0]
    nodes[turned, 2] += 0.008
    scene.show(replace(frame, nodes=nodes))
    assert len(line.points) > 10


def test_the_robot_is_moved_by_its_links(served: SafeServer, scene: Scene) -> None:
    frame = initial_frame("hanger", "towel")
    scene.show(frame)
    hand = node(served, "/bench/robot/hanger 7")
    assert tuple(hand.color) == colors.HOLDER
    before, vertices = np.array(hand.position), hand.vertices.copy()
    scene.show(replace(frame, joints=frame.joints + 0.1, step=1))
    assert np.linalg.norm(np.array(hand.position) - before) > 0.01
    np.testing.assert_array_equal(hand.vertices, vertices)


def test_another_robot_replaces_the_first_one(served: SafeServer, scene: Scene) -> None:
    scene.show(initial_frame("hanger", "towel"))
    scene.show(initial_frame("pickers", "napkin"))
    names = [name for name in served.server.scene._handle_from_node_name if name.startswith("/bench/robot/")]
    assert sorted(names) == ["/bench/robot/picker 1", "/bench/robot/picker 2"]


def test_the_landing_place_lies_below_the_free_edge(served: SafeServer, scene: Scene) -> None:
    frame = initial_frame("hanger", "towel")
    spec = cloth_spec("towel")
    corners = landing(spec, frame.nodes)
    assert corners is not None
    np.testing.assert_allclose(np.ptp(corners[:, :2], axis=0), (spec.length_m, spec.width_m))
    assert corners[:, 0].min() == pytest.approx(frame.nodes[: spec.columns, 0].mean())
    scene.show(frame)
    assert len(node(served, "/bench/target").points) == 4
    assert landing(spec, spec.flat_nodes()) is None


def test_a_frame_without_a_cloth_or_with_nan_is_left_out(served: SafeServer, scene: Scene) -> None:
    frame = initial_frame("hanger", "towel")
    scene.show(replace(frame, nodes=np.zeros((0, 3))))
    scene.show(frame)
    scene.show(replace(frame, nodes=np.full_like(frame.nodes, np.nan), step=1))
    assert np.isfinite(node(served, "/bench/cloth/reverse").vertices).all()


def event(phase: str, start: Any, end: Any, client_id: int = 3) -> Any:
    return SimpleNamespace(phase=phase, start_position=tuple(start), end_position=tuple(end), client_id=client_id)


@pytest.mark.parametrize("offset_m", [(0.0, 0.0, 0.0), (0.0, 1.3, 0.0)])
def test_a_drag_pulls_the_node_where_it_began(served: SafeServer, offset_m: tuple[float, float, float]) -> None:
    scene = Scene(served.server.scene, name="/dragged", offset_m=offset_m)
    heard: list[tuple[int, DragTarget | None]] = []
    frame = initial_frame("hanger", "towel")
    scene.let_drag(lambda client, drag: heard.append((client, drag)))
    scene.show(frame)
    grab = frame.nodes[40] + offset_m
    for one in (event("start", grab + 0.004, grab), event("update", grab, np.add(grab, (0.1, 0.0, -9.0))),
                event("update", grab, grab, client_id=4), event("end", grab, grab)):  # fmt: skip
        asyncio.run(scene._dragged(one))
    pulls = [drag for _, drag in heard[:-1]]
    assert [client for client, _ in heard] == [3, 3, 3]
    assert all(drag is not None and drag.node == 40 for drag in pulls)
    assert heard[-1][1] is None
    assert pulls[-1] is not None
    np.testing.assert_allclose(
        pulls[-1].target_m, [*(frame.nodes[40] + [0.1, 0.0, 0.0])[:2], LOWEST_TARGET_M], atol=1e-9
    )
    scene.remove()


def test_a_pull_is_a_rubber_band(served: SafeServer, scene: Scene) -> None:
    frame = initial_frame("hanger", "towel")
    drag = DragTarget(node=7, target_m=frame.nodes[7] + 0.1)
    scene.show(replace(frame, drag=drag))
    np.testing.assert_allclose(node(served, "/bench/band").points, [[frame.nodes[7], frame.nodes[7] + 0.1]], atol=1e-6)
    scene.show(replace(frame, step=1))
    assert len(node(served, "/bench/band").points) == 0


@pytest.mark.parametrize(("robot", "free"), [("hanger", [(True, False, True)]), ("pickers", [(True, True, True)] * 2)])
def test_arrows_guide_each_point_along_its_axes(
    served: SafeServer, scene: Scene, robot: str, free: list[tuple[bool, ...]]
) -> None:
    heard: list[Any] = []
    scene.let_guide(lambda client, hand: heard.append(hand))
    frame = initial_frame(robot, "towel")
    scene.show(frame)
    arrows = [node(served, f"/bench/robot/guide {k + 1}") for k in range(len(free))]
    assert [tuple(one.active_axes) for one in arrows] == free
    arrows[0].position = np.add(arrows[0].position, (0.05, 0.0, 0.0))
    for phase in ("update", "end"):
        for callback in arrows[0]._impl_aux.update_cb:
            asyncio.run(callback(SimpleNamespace(phase=phase, client_id=1)))
    moved, end = heard
    assert end is None
    assert np.shape(moved) == ((3,) if robot == "hanger" else (2, 3))
    at = frame.holder if robot == "hanger" else frame.corners[0]
    np.testing.assert_allclose(np.reshape(moved, (-1, 3))[0], np.add(at, (0.05, 0.0, 0.0)), atol=1e-6)
    scene.let_guide(None)
    assert served.server.scene.get_handle_by_name("/bench/robot/guide 1") is None


def test_a_ghost_comes_and_goes(served: SafeServer, scene: Scene) -> None:
    frame = initial_frame("hanger", "towel")
    scene.show(frame)
    ghost = node(served, "/bench/cloth/ghost")
    assert not ghost.visible
    scene.show_ghost(frame.nodes + 0.1)
    assert ghost.visible
    scene.show_ghost(cloth_spec("napkin").flat_nodes())  # Another cloth cannot lead this one.
    assert not ghost.visible


def test_a_frame_sends_little(served: SafeServer, scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """An arm that is sent by its vertices, or a cloth that is sent whole again, takes several times as much."""
    frame = initial_frame("hanger", "towel")
    scene.show(frame)
    sent: list[Any] = []
    monkeypatch.setattr(served.server.scene, "_queue_scene_message", sent.append)
    scene.show(replace(frame, nodes=frame.nodes + 0.01, joints=frame.joints + 0.01, step=1))
    arrays: list[Any] = []
    for message in sent:
        message.as_serializable_dict(arrays)
    assert 0 < sum(memoryview(array).nbytes for array in arrays) < FRAME_BYTES
    sent.clear()
    scene.show(replace(frame, nodes=frame.nodes + 0.01, joints=frame.joints + 0.01, step=2))
    assert sent == []  # Nothing has changed.


def test_views_look_from_the_side_above_and_in_front() -> None:
    assert VIEWS["Side"][1] < -1
    assert VIEWS["Top"][2] > 1
    assert VIEWS["Front"][0] > 1
