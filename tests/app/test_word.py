"""`layflat word` on frames saved as a RealSense user saves them: drawn scenes, and the simulator's camera."""

from __future__ import annotations

import json
import math
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from layflat.app.cli import main
from layflat.perception.camera.pinhole import PinholeCamera
from layflat.perception.descriptors.registry import DESCRIPTORS
from layflat.sim.camera.camera import TARGET_M
from layflat.sim.camera.depth_noise import DepthNoise, DepthSensor
from layflat.sim.camera.renderer import Renderer
from layflat.sim.cloth.mesh import MeshMaker
from layflat.sim.cloth.registry import cloth_spec
from layflat.tests.scenes import CLOTHS, Scene, shoot, stand

CONTRACT = {"schema", "word", "word_axial", "coherence", "strength"}
CONTRACT |= {"cloth_pixels", "contact_pixels", "contact_portion"}
GOOD = ("good-rgb.png", "good-depth.png")
NO_PICTURES = ("empty", "half", "no-end", "flipped", "short-data", "bad-data", "no-data")


@pytest.fixture
def run(capsys, monkeypatch, tmp_path):
    """Return a function that runs ``layflat word`` in an empty folder and gives status, stdout and stderr."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments):
        with pytest.raises(SystemExit) as stop:
            main.main(["word", *map(str, arguments)])
        out, err = capsys.readouterr()
        return int(stop.value.code or 0), out, err

    return call


@pytest.fixture
def analyze(run, frames):
    """Return a function that runs the command on a frame by name and gives its JSON object."""

    def call(name, *options):
        depth = frames / f"{name}-depth.png"
        assert run(frames / f"{name}-rgb.png", depth, *options, "--json", "out.json", "--force")[0] == 0
        return json.loads(Path("out.json").read_text())

    return call


def _sheet_frame(folder: Path, name: str, scene: Scene, **place):
    camera, lens = stand(**({"width": 320, "height": 240, "tilt": 30.0} | place))
    shoot(scene, camera, lens, seed=1, missing=0.05).save(folder, name)


def _png(header: bytes, *data: bytes) -> bytes:
    """Return a PNG with right checksums and any content."""
    chunks = [(b"IHDR", header), *((b"IDAT", part) for part in data), (b"IEND", b"")]
    parts = [
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body)) for kind, body in chunks
    ]
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


@pytest.fixture(scope="module")
def frames(tmp_path_factory) -> Path:
    """Return a folder with good and bad pictures."""
    folder = tmp_path_factory.mktemp("frames")
    _sheet_frame(folder, "good", Scene(amplitude=0.003))
    _sheet_frame(folder, "red", Scene(cloth=CLOTHS["red"], lift_from=0.0), roll=12.0)
    _sheet_frame(folder, "flat", Scene(amplitude=0.0))
    _sheet_frame(folder, "cut", Scene(centre=(0.38, 0.0)))
    rgb, depth = cv2.imread(str(folder / "good-rgb.png")), cv2.imread(str(folder / "good-depth.png"), -1)
    grey = cv2.cvtColor(rgb, cv2.COLOR_BGR2GRAY)
    for name, pixels in {
        "rgba": np.dstack([rgb, np.full_like(grey, 255)]),
        "grey": grey,
        "rgb16": rgb.astype(np.uint16) * 257,
        "depth8": (depth // 8).astype(np.uint8),
        "depth3": np.dstack([depth] * 3),
        "depth-0": 0 * depth,
        "depth-half": depth[::2, ::2],
        "depth-narrow": depth[:, :200],
        "mask-narrow": (grey[:, :200] > 150).astype(np.uint8),
        "depth-2mm": np.where(depth > 0, 2, 0).astype(np.uint16),
        "depth-20m": np.minimum(depth.astype(int) * 25, 65535).astype(np.uint16),
        "black": 0 * grey,
        "tiny": rgb[:3, :3],
        "tiny-depth": depth[:3, :3],
    }.items():
        cv2.imwrite(str(folder / f"{name}.png"), pixels)
    whole = (folder / "good-rgb.png").read_bytes()
    size = struct.pack(">IIBBBBB", 320, 240, 8, 2, 0, 0, 0)
    for name, content in {
        "text": b"dear diary",
        "empty": b"",
        "half": whole[: len(whole) // 2],
        "no-end": whole[:-9],
        "flipped": whole[:5000] + bytes([whole[5000] ^ 255]) + whole[5001:],
        "short-data": _png(size, zlib.compress(bytes(1000))),
        "bad-data": _png(size, b"garbage"),
        "no-data": _png(size),
        "vast": _png(struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0), b""),
        "large": _png(struct.pack(">IIBBBBB", 9_000, 9_000, 8, 2, 0, 0, 0), b""),
    }.items():
        (folder / f"{name}.png").write_bytes(content)
    cv2.imwrite(str(folder / "photo.jpg"), rgb)
    metres = np.where(depth > 0, depth.astype(np.float32) / 1000, np.nan)
    for name, pixels in {
        "metres": metres,
        "millimetres": metres * 1000,
        "nothing": metres * np.nan,
        "floats3": np.dstack([metres] * 3),
        "doubles": metres.astype(np.float64),
        "bytes": (depth // 8).astype(np.uint8),
    }.items():
        cv2.imwrite(str(folder / f"{name}.tiff"), pixels)
    whole = (folder / "metres.tiff").read_bytes()
    (folder / "half.tiff").write_bytes(whole[: len(whole) // 2])
    return folder


def test_a_frame_in_the_contracts_form(frames, run):
    status, out, err = run(
        frames / "good-rgb.png", frames / "good-depth.png", "--json", "new/out.json", "--overlay", "new/over.png"
    )
    assert (status, err) == (0, "")
    result = json.loads(Path("new/out.json").read_text())
    assert set(result) >= CONTRACT
    assert result["schema"] == 1
    assert result["contact_portion"] is None
    assert 0 <= result["contact_pixels"] <= result["cloth_pixels"]
    for name in ("word", "word_axial"):
        assert math.hypot(*result[name]) == pytest.approx(1.0)
        assert result[name][0] >= 0
    angle = math.degrees(math.atan2(result["word_axial"][1], result["word_axial"][0]))
    assert angle == pytest.approx(30.0, abs=5.0)  # the scene's wrinkles, seen by a camera that is not rolled
    assert result["intrinsics"]["assumed"]
    assert "assumed" in out
    assert "suggested" in out
    picture = cv2.imread("new/over.png")
    assert picture.shape == (240, 320, 3)
    assert (picture != cv2.imread(str(frames / "good-rgb.png"))).any()
    assert len(list(Path("new").iterdir())) == 2


def test_flat_cloth_has_no_direction_and_counts_for_the_portion(analyze):
    flat = analyze("flat")
    assert flat["word"] is flat["word_axial"] is None
    assert flat["strength"] < flat["min_strength"]
    count = flat["cloth_pixels"]
    assert analyze("flat", "--flat-pixels", count)["contact_portion"] == pytest.approx(1.0, abs=0.02)
    lifted = analyze("red", "--flat-pixels", count)
    assert 0.3 < lifted["contact_portion"] < 0.6  # half of it rises
    assert lifted["hsv"]["hue_min"] > lifted["hsv"]["hue_max"]


def axial_deg(result) -> float:
    return math.degrees(math.atan2(result["word_axial"][1], result["word_axial"][0]))


@pytest.mark.parametrize("name", ["flat", "good"])
def test_stripes_are_no_wrinkles(name, frames, run):
    """Dark stripes along x, 40 px apart, on a cloth without and with wrinkles across 30 degrees."""
    rgb = cv2.imread(str(frames / f"{name}-rgb.png"))
    cloth = rgb[..., 0] > rgb[..., 2].astype(int) + 40
    stripes = cloth & (np.arange(len(rgb)) % 40 < 20)[:, None]
    cv2.imwrite("rgb.png", np.where(stripes[..., None], np.rint(0.6 * rgb), rgb).astype(np.uint8))
    options = ("--hsv", "195,255,0.35,0.1", "--descriptor", "hog", "--regions", "--json", "out.json")
    assert run("rgb.png", frames / f"{name}-depth.png", *options)[0] == 0
    result = json.loads(Path("out.json").read_text())
    assert result["descriptor"]["strength"] > 0.01  # that of the stripes: HOG sees them
    if name == "flat":
        assert result["word"] is result["word_axial"] is result["descriptor"]["direction"] is None
        assert result["strength"] < result["min_strength"]
        assert result["regions"] == []
    else:
        assert axial_deg(result) == pytest.approx(30.0, abs=3.0)


def test_regions_of_a_cloth_that_is_wrinkled_two_ways(run, tmp_path):
    """Wrinkles across 30 degrees, laid beside the same cloth turned by a quarter."""
    _sheet_frame(tmp_path, "one", Scene(amplitude=0.003, yaw=0.0), tilt=0.0, width=640, height=480)
    _sheet_frame(tmp_path, "two", Scene(amplitude=0.003, yaw=0.0, normal=120.0), tilt=0.0, width=640, height=480)
    for kind in ("rgb", "depth"):
        one, two = (cv2.imread(f"{name}-{kind}.png", cv2.IMREAD_UNCHANGED) for name in ("one", "two"))
        cv2.imwrite(f"{kind}.png", np.hstack([one[:, :320], two[:, 320:]]))
    status, out, _ = run("rgb.png", "depth.png", "--json", "out.json")
    result = json.loads(Path("out.json").read_text())
    assert status == 0
    assert result["word"] is result["word_axial"] is None
    assert result["coherence"] < 0.2
    assert result["strength"] > 2 * result["min_strength"]  # not that of a flat cloth
    assert "run several ways; --regions" in out
    plain = ("--overlay", "plain.png")
    _, out, _ = run("rgb.png", "depth.png", *plain, "--regions", "--json", "out.json", "--force")
    run("rgb.png", "depth.png", "--overlay", "without.png")
    assert (cv2.imread("plain.png") != cv2.imread("without.png")).any()
    regions = json.loads(Path("out.json").read_text())["regions"]
    assert len(regions) >= 2
    assert out.count("\nregion ") == len(regions)
    assert sum(region["share"] for region in regions) <= 1.0
    for region in regions:
        side = np.sign(region["pixel"][0] - 320)
        if region["coherence"] < 0.5:  # on the seam
            assert abs(region["pixel"][0] - 320) < 40
            continue
        assert side == np.sign(region["place_m"][0])
        assert abs((axial_deg(region) - (30 if side < 0 else 120) + 90) % 180 - 90) < 8.0
        assert region["strength"] > 0.1
    assert sum(region["share"] for region in regions if region["coherence"] > 0.5) > 0.6


def test_the_color_given_learned_and_suggested_see_the_same_cloth(frames, run, analyze):
    options = {"suggested": (), "learned": ("--cloth-at", "160,120"), "given": ("--hsv", "340,20,0.4,0.1")}
    results = {source: analyze("red", *option) for source, option in options.items()}
    counts = [result["cloth_pixels"] for result in results.values()]
    assert max(counts) / min(counts) < 1.02
    pair = (frames / "red-rgb.png", frames / "red-depth.png")
    for source, result in results.items():
        assert result["hsv"]["source"] == source
        out = run(*pair, *options[source])[1]
        assert source in out
    again = next(line for line in out.splitlines() if "--hsv" in line).split("--hsv ")[1]
    assert run(*pair, "--hsv", again)[0] == 0


def test_depth_scale_is_the_unit(frames, run, analyze):
    one = analyze("good")
    depth = cv2.imread(str(frames / "good-depth.png"), cv2.IMREAD_UNCHANGED)
    cv2.imwrite("quarter.png", depth * 4)
    assert run(frames / "good-rgb.png", "quarter.png", "--depth-scale", "0.25", "--json", "two.json")[0] == 0
    two = json.loads(Path("two.json").read_text())
    assert two["plane"]["distance_mm"] == pytest.approx(one["plane"]["distance_mm"], abs=0.1)
    assert two["contact_pixels"] == pytest.approx(one["contact_pixels"], rel=1e-3)


@pytest.mark.parametrize(("name", "options"), [("metres", ()), ("millimetres", ("--depth-scale", "1"))])
def test_a_tiff_with_floats_is_the_same_depth(name, options, frames, run, analyze):
    status, _, err = run(frames / "good-rgb.png", frames / f"{name}.tiff", *options, "--json", "tiff.json")
    assert (status, err) == (0, "")
    result, png = json.loads(Path("tiff.json").read_text()), analyze("good")
    assert result.pop("depth_scale_mm") == (1.0 if options else 1000.0)
    assert png.pop("depth_scale_mm") == 1.0
    assert result["contact_pixels"] == pytest.approx(png["contact_pixels"], rel=1e-3)
    assert result["plane"]["distance_mm"] == pytest.approx(png["plane"]["distance_mm"], abs=0.01)


def test_the_seed_decides_and_hardly_matters(analyze):
    one, again, other = (analyze("good", "--seed", seed) for seed in (0, 0, 7))
    assert one == again
    assert other["contact_pixels"] == pytest.approx(one["contact_pixels"], rel=0.01)


def test_transparency_is_dropped_and_nothing_is_written_unasked(frames, run, tmp_path):
    outputs = [run(frames / name, frames / "good-depth.png") for name in ("rgba.png", "good-rgb.png")]
    assert outputs[0] == outputs[1]
    assert outputs[0][0] == 0
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", DESCRIPTORS)
def test_every_descriptor_gives_its_vector(name, analyze):
    found = analyze("good", "--descriptor", name, "--overlay", "d.png")["descriptor"]
    assert found["name"] == DESCRIPTORS[name]().name
    assert len(found["vector"]) == DESCRIPTORS[name]().size
    assert np.isfinite(found["vector"]).all()


@pytest.mark.parametrize("width", [640, 1280])
def test_the_simulators_camera_rolled_and_with_noise(width, run):
    """Wrinkles of known direction in the simulator's own picture; the command knows nothing of the camera."""
    height, roll = width * 9 // 16 if width > 1000 else width * 3 // 4, math.radians(-15)
    up, size = (math.sin(roll), 0, math.cos(roll)), {"width": width, "height": height, "fx": 615 / 480 * height}
    pinhole = PinholeCamera.look_at((0.25, -0.55, 0.75), TARGET_M, up, **size)
    spec = cloth_spec("towel")
    nodes = spec.flat_nodes(x_m=0.1)
    normal = math.radians(25)
    nodes[:, 2] += 0.004 * (1 + np.sin(2 * np.pi * (nodes[:, :2] @ [math.cos(normal), math.sin(normal)]) / 0.1))
    view = Renderer(pinhole)
    picture = view.background()
    view.draw_cloth(picture, MeshMaker(spec).mesh(nodes))
    true_depth = np.where(np.isfinite(picture.depth), picture.depth, np.float32(0)).reshape(height, width)
    depth = DepthSensor(DepthNoise(), seed=3).measure(true_depth)
    cv2.imwrite("rgb.png", picture.rgb.reshape(height, width, 3)[..., ::-1])
    cv2.imwrite("depth.png", np.rint(1000 * depth).astype(np.uint16))
    assert run("rgb.png", "depth.png", "--json", "out.json")[0] == 0
    result = json.loads(Path("out.json").read_text())
    assert result["plane"]["distance_mm"] == pytest.approx(750, abs=1.0)
    tilt = math.degrees(math.acos(-pinhole.cam_to_world[2, 2]))
    assert result["plane"]["tilt_deg"] == pytest.approx(tilt, abs=0.1)
    # The wrinkles' normal, from the world to the table's axes that the image gives.
    up, right = pinhole.cam_to_world[2, :3], np.array([1.0, 0.0, 0.0])
    x = right - up[0] * up
    x /= np.linalg.norm(x)
    seen = pinhole.cam_to_world[:3, :3].T @ [math.cos(normal), math.sin(normal), 0.0]
    expected = math.degrees(math.atan2(seen @ np.cross(up, x), seen @ x))
    angle = math.degrees(math.atan2(result["word_axial"][1], result["word_axial"][0]))
    assert abs((angle - expected + 90) % 180 - 90) < 8.0


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        (("good-rgb.png", "depth-narrow.png"), "of another shape"),
        ((*GOOD, "--mask", "mask-narrow.png"), "mask-narrow.png is 200x240 px"),
        ((*GOOD, "--mask", "black.png"), "black everywhere"),
        ((*GOOD, "--mask", "good-rgb.png"), "not black everywhere"),
        (("good-rgb.png", "depth8.png"), "8 bits"),
        (("good-rgb.png", "depth3.png"), "3 channels"),
        (("good-rgb.png", "depth-0.png"), "65535 everywhere"),
        (("good-rgb.png", "depth-2mm.png"), "unit"),
        (("good-rgb.png", "depth-20m.png"), "unit"),
        (("good-rgb.png", "millimetres.tiff"), "unit"),
        (("good-rgb.png", "metres.tiff", "--depth-scale", "1"), "unit"),
        (("good-rgb.png", "nothing.tiff"), "no depth at all"),
        (("good-rgb.png", "floats3.tiff"), "TIFF with floats"),
        (("good-rgb.png", "doubles.tiff"), "TIFF with floats"),
        (("good-rgb.png", "bytes.tiff"), "8 bits"),
        (("good-rgb.png", "half.tiff"), "not a whole picture"),
        (("metres.tiff", "good-depth.png"), "TIFF"),
        (("good-rgb.png", "text.png"), "not a whole picture"),
        (("good-rgb.png", "missing.png"), "does not exist"),
        (("good-rgb.png", "."), "not a file"),
        (("good-rgb.png", "photo.jpg"), "JPEG"),
        (("good-depth.png", "good-rgb.png"), "is it the depth?"),
        (("rgb16.png", "good-depth.png"), "16 bits"),
        (("tiny.png", "tiny-depth.png"), "at least 400"),
        (("vast.png", "good-depth.png"), "million"),
        (("large.png", "good-depth.png"), "million"),
        (("cut-rgb.png", "cut-depth.png"), "cut by the image's border"),
        ((*GOOD, "--hsv", "0,20,0.4,0.1"), "no cloth"),
        ((*GOOD, "--hsv", "0,20,0.4"), "4 numbers"),
        ((*GOOD, "--hsv", "0,500,0.4,0.1"), "0..360"),
        ((*GOOD, "--hsv", "nan,20,0.4,0.1"), "4 numbers"),
        ((*GOOD, "--hsv", "0,360,0,0"), "both 0"),
        ((*GOOD, "--hsv", "0,20,0.4,0.1", "--cloth-at", "3,3"), "one of them"),
        ((*GOOD, "--hsv", "0,20,0.4,0.1", "--mask", "grey.png"), "one of them"),
        ((*GOOD, "--cloth-at", "5,5"), "is grey"),
        ((*GOOD, "--cloth-at", "320,5"), "outside the image"),
        ((*GOOD, "--cloth-at=-1,5"), "outside the image"),
        ((*GOOD, "--cloth-at", "here"), "2 numbers"),
        ((*GOOD, "--cloth-at", "1e99,5"), "must be a pixel"),
        ((*GOOD, "--intrinsics", "615,615"), "4 numbers"),
        ((*GOOD, "--intrinsics", "1e308,1e308,160,120"), "cannot be those"),
        ((*GOOD, "--intrinsics", "0,307,160,120"), "cannot be those"),
        ((*GOOD, "--intrinsics", "307,307,1600,120"), "cannot be those"),
        ((*GOOD, "--depth-scale", "0"), "--depth-scale is 0"),
        ((*GOOD, "--depth-scale", "nan"), "--depth-scale is nan"),
        ((*GOOD, "--depth-scale", "100"), "unit"),
        ((*GOOD, "--contact-mm", "30"), "--contact-mm is 30"),
        ((*GOOD, "--contact-mm", "nan"), "--contact-mm is nan"),
        ((*GOOD, "--flat-pixels", "0"), "--flat-pixels is 0"),
        ((*GOOD, "--descriptor", "silk"), "'silk' is unknown"),
        ((*GOOD, "--json", "text.png"), ".json"),
        ((*GOOD, "--overlay", "text.png"), "--force"),
        ((*GOOD, "--overlay", "over.jpg"), ".png"),
        ((*GOOD, "--json", "good-rgb.png", "--force"), "named twice"),
        ((*GOOD, "--json", "x.png", "--overlay", "x.png"), "named twice"),
        ((*GOOD, "--json", "."), ".json"),
        ((*GOOD, "--json", "/proc/nowhere/x.json"), "cannot be written"),
        ((*GOOD, "--overlay", "text.png/x.png"), "cannot be written"),
        *(((f"{name}.png", "good-depth.png"), "not a whole picture") for name in NO_PICTURES),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_bad_input_is_one_sentence(arguments, hint, frames, run, monkeypatch):
    monkeypatch.chdir(frames)
    before = {path: path.read_bytes() for path in frames.rglob("*") if path.is_file()}
    status, out, err = run(*arguments)
    assert (status, out) == (2, ""), err
    assert err.startswith("layflat: ")
    assert err.count("\n") == 1
    assert hint in err
    assert {path: path.read_bytes() for path in frames.rglob("*") if path.is_file()} == before


def test_a_refusal_leaves_only_the_overlay_and_force_replaces_one(frames, run, tmp_path):
    status, _, err = run(frames / "cut-rgb.png", frames / "cut-depth.png", "--json", "a.json", "--overlay", "a.png")
    assert status == 2
    assert "the blue cloth is cut" in err
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]  # it shows what was found
    (tmp_path / "a.json").write_text("old")
    assert run(frames / "good-rgb.png", frames / "good-depth.png", "--json", "a.json", "--force")[0] == 0
    assert json.loads((tmp_path / "a.json").read_text())["schema"] == 1


def test_flat_pixels_of_another_cloth_are_noticed(frames, run):
    _, out, _ = run(frames / "flat-rgb.png", frames / "flat-depth.png", "--flat-pixels", 5000)
    assert "counted with this cloth" in out
