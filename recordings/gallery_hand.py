"""A hand in the gallery, 3,653 frames at 60 Hz: idle in the air, over the table and back, then it pushes the ball.

Half of the time the hand rests in the air before the table. Then it slides to the left with its palm on the table top,
breaks contact, slides back, is lifted, turned thumb up, and sweeps through the place where the ball lies. While it
slides it is recorded 5 to 20 mm deep in the table, as a hand is that feels no table.
"""

from __future__ import annotations

import tomllib

import numpy as np
from hand_motion import ASSETS, GLOVE_TOPIC, WRIST_TOPIC, glove, load_hand, palm_links, tracker, turned, unsteady
from mcap_files import Recording
from motion import Restless, softened, through, turned_through
from turns import euler, transforms

FRAMES = 3653
RATE = 60.0
SCENE = ASSETS / "scenes" / "gallery.toml"
TABLE_TOP = 0.76

REST = euler(78, -8, 28)
DOWN = euler(90, 0, 0)
SWEEP = euler(92, 0, 88)

FINGER_KEYS = [
    (0.0, "relaxed"), (3.0, "relaxed"), (5.5, "open"), (7.5, "open"), (9.5, "half_fist"), (12.0, "relaxed"),
    (15.0, "pointing"), (18.0, "relaxed"), (21.0, "half_fist"), (23.5, "open"), (26.0, "relaxed"),
    (30.0, "relaxed"), (32.0, "flat"), (40.2, "flat"), (41.0, "relaxed"), (41.9, "flat"), (49.3, "flat"),
    (50.6, "relaxed"), (53.0, "sweep"), (57.6, "sweep"), (59.5, "relaxed"),
]  # fmt: skip
# palm over the table (m): x and y of its frame, which is the centre of the wrist
PLACE_KEYS = [
    (0.0, (2.42, 1.05)), (6.0, (2.35, 1.02)), (11.0, (2.25, 1.08)), (17.0, (2.45, 1.00)), (24.0, (2.38, 1.06)),
    (30.4, (2.45, 1.10)), (32.4, (2.50, 1.30)), (33.2, (2.48, 1.30)), (39.8, (1.70, 1.31)), (40.8,
    (1.66, 1.28)), (41.8, (1.68, 1.29)), (42.4, (1.70, 1.30)), (49.0, (2.45, 1.29)), (50.4, (2.52, 1.24)),
    (52.8, (2.34, 1.53)), (53.6, (2.33, 1.545)), (57.0, (1.42, 1.54)), (57.6, (1.42, 1.50)), (60.0,
    (1.75, 1.20)),
]  # fmt: skip
# lowest point of the hand over the table top (m): below zero it is in the wood
HEIGHT_KEYS = [
    (0.0, 0.24), (8.0, 0.28), (16.0, 0.22), (25.0, 0.27), (30.4, 0.25), (32.2, 0.06), (33.3, -0.010),
    (35.0, -0.014), (37.0, -0.010), (38.5, -0.016), (39.7, -0.011), (40.6, 0.085), (41.4, 0.085),
    (42.5, -0.009), (44.5, -0.015), (46.5, -0.011), (48.0, -0.017), (49.0, -0.012), (50.2, 0.14), (51.5, 0.14),
    (53.4, 0.016), (57.2, 0.016), (58.6, 0.16), (60.8, 0.24),
]  # fmt: skip
TURN_KEYS = [
    (0.0, REST), (6.0, euler(84, 4, 18)), (13.0, euler(70, -12, 40)), (20.0, euler(88, -2, 12)), (27.0, REST),
    (30.4, REST), (32.2, DOWN), (36.5, euler(94, 0, 0)), (40.0, euler(97, 0, -1)), (41.4, euler(95, 3, 2)),
    (42.4, euler(96, 0, 0)), (49.0, euler(88, 0, 0)), (50.4, euler(86, -4, 12)), (52.8, SWEEP),
    (57.2, euler(98, 0, 86)), (59.6, REST),
]  # fmt: skip


def make() -> Recording:
    """The recording, ready to be written."""
    t = np.arange(FRAMES) / RATE
    restless = Restless(20041, t)
    pressed = through(
        t, [(31.6, 0.0), (33.2, 1.0), (39.8, 1.0), (40.6, 0.3), (41.6, 0.3), (42.4, 1.0), (49.0, 1.0), (50.2, 0.0)]
    )
    hand = load_hand()
    angles = glove(hand, restless, FINGER_KEYS, 1.0 - 0.75 * pressed)
    links = hand.forward(angles, FRAMES)
    turns = unsteady(restless, turned_through(t, TURN_KEYS), 0.9)

    reach = softened(hand.lowest(turned(palm_links(links), turns)), 0.15 * RATE)
    sway = restless.drift(0.006) * (1.0 - 0.8 * pressed)[:, None] + restless.tremor(0.00012)
    palm = np.empty((FRAMES, 3))
    palm[:, :2] = through(t, PLACE_KEYS) + sway[:, :2]
    palm[:, 2] = TABLE_TOP + through(t, HEIGHT_KEYS) - reach + 0.35 * sway[:, 2]

    poses = {WRIST_TOPIC: tracker(transforms(palm, turns), links, SCENE)}
    if tomllib.loads(SCENE.read_text(encoding="utf-8"))["avatar"][0]["root"]["topic"] != WRIST_TOPIC:
        raise ValueError(f"{SCENE.name} does not follow {WRIST_TOPIC}")
    note = "gallery hand: idle, slide over the table, break, slide back, push the ball"
    return Recording(RATE, poses, {GLOVE_TOPIC: angles}, note)
