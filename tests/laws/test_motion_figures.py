"""The figures of motion in an output, against derivatives taken anew from the poses in the same file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

import geomphys
from tests.driven.logs import Thing, play, wander
from tests.scene.models import joint, link, urdf

FRAMES = 150  # more than two blocks of the pipeline
HAND = '[[avatar]]\nname="hand"\nurdf="hand.urdf"\nmode="rigid"\nmaterial="human"\n'
HAND += 'root={topic="/wrist"}\njoints={topic="/angles"}\n'


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A hand and a mug over a table, with a mover and a ball that are not driven."""
    folder, rng = tmp_path_factory.mktemp("motion"), np.random.default_rng(4)
    urdf(
        folder / "hand.urdf",
        link("palm", '<geometry><box size="0.08 0.1 0.03"/></geometry>'),
        link("finger", '<origin xyz="0 0 0.04"/><geometry><cylinder radius="0.01" length="0.06"/></geometry>'),
        joint("knuckle", "palm", "finger", inside='<axis xyz="1 0 0"/>', xyz="0 0 0.02"),
    )
    wrist, mug, fan = (wander(rng, FRAMES, *reach) for reach in ((0.15, 0.6), (0.1, 0.4), (2.0, 30.0)))
    mug[:, 0] += 0.5
    fan[:, 2] += 5.0
    things = [
        Thing(name="table", shape=("box", 2, 2, 0.1), at=(0, 0, -0.05)),
        Thing(name="fan", shape=("box", 0.1, 0.1, 0.1), path=fan),
        Thing(name="ball", shape=("sphere", 0.03), role="simulated", at=(0, 0.8, 3.0)),
        Thing(name="mug", shape=("cylinder", 0.04, 0.1), role="driven", path=mug),
    ]
    angles = np.sin(np.arange(FRAMES) / 9)[:, None]
    play(folder, things, avatars=HAND, roots={"/wrist": wrist}, angles={"/angles": (["knuckle"], angles)})
    geomphys.run(folder / "log.mcap", folder / "scene.toml", out=folder / "out.mcap")
    return folder / "out.mcap"


def columns(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """(times [s], recorded (N, B, 7), corrected (N, B, 7) of the driven bodies, metrics by name), by the mcap library."""
    names = ("palm", "finger", "mug")
    times, found, figures = [], {"/tf": [], "/recorded/tf": []}, []
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages(["/tf", "/recorded/tf", "/metrics"]):
            if channel.topic == "/metrics":
                times.append(message.log_time)
                figures.append(decoded)
                continue
            poses = {t.child_frame_id.removeprefix("recorded/"): t for t in decoded.transforms}
            contacts = []
            for p, q in ((poses[name].translation, poses[name].rotation) for name in names):
                contacts.append([p.x, p.y, p.z, q.x, q.y, q.z, q.w])
            found[channel.topic].append(contacts)
    keys = [field.name for field in figures[0].DESCRIPTOR.fields if field.name != "timestamp"]
    seconds = (np.array(times) - times[0]) * 1e-9
    metrics = {key: np.array([getattr(f, key) for f in figures]) for key in keys}
    return seconds, np.array(found["/recorded/tf"]), np.array(found["/tf"]), metrics


def derivative(times: np.ndarray, places: np.ndarray, order: int) -> np.ndarray:
    """(N,) length of the derivative of the polynomial through the last order + 1 places (N, B, 3), of the body that has
    the largest; 0 in the first frames."""
    found = np.zeros(len(times))
    for k in range(order, len(times)):
        t = times[k - order : k + 1] - times[k - order]
        contacts = places[k - order : k + 1].reshape(order + 1, -1)
        leading = np.linalg.solve(np.vander(t), contacts)[0] * np.prod(np.arange(1, order + 1))
        found[k] = np.linalg.norm(leading.reshape(-1, 3), axis=1).max()
    return found


def test_metrics_tell_correction_speed_and_jerk_of_the_poses_beside_them(out: Path) -> None:
    times, recorded, corrected, metrics = columns(out)
    assert len(times) == FRAMES
    r, c = recorded[..., :3], corrected[..., :3]
    assert metrics["correction_m"] == pytest.approx(np.linalg.norm(c - r, axis=2).max(axis=1), abs=1e-15)
    assert metrics["correction_m"].max() > 0.01
    for name, places in (("recorded", r), ("correction", c - r)):
        assert metrics[f"{name}_speed_m_s"] == pytest.approx(derivative(times, places, 1), rel=1e-9, abs=1e-9)
        assert metrics[f"{name}_jerk_m_s3"] == pytest.approx(derivative(times, places, 3), rel=1e-6, abs=1e-4)
    assert metrics["correction_jerk_m_s3"].max() > 10.0
    dots = np.abs(np.sum(recorded[..., 3:] * corrected[..., 3:], axis=2)).clip(max=1.0)
    assert metrics["correction_rad"] == pytest.approx(2 * np.arccos(dots).max(axis=1), abs=1e-7)


def test_stats_are_the_percentiles_of_these(out: Path) -> None:
    times, recorded, corrected, _ = columns(out)
    r, c = recorded[..., :3], corrected[..., :3]
    values = json.loads(json.dumps(geomphys.statistics_of([out]).as_dict()))["all"]["values"]
    for name, places in (("recorded", r), ("corrected", c), ("correction", c - r)):
        for what, order, near in (("speed_m_s", 1, 1e-9), ("jerk_m_s3", 3, 1e-6)):
            expected, found = derivative(times, places, order)[order:], values[f"{name}_{what}"]
            assert found["count"] == FRAMES - order
            assert found["max"] == pytest.approx(expected.max(), rel=near)
            assert found["mean"] == pytest.approx(expected.mean(), rel=near)
            assert found["p50"] == pytest.approx(np.median(expected), rel=near)
            assert found["p95"] == pytest.approx(np.quantile(expected, 0.95, method="inverted_cdf"), rel=near)
