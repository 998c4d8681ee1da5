"""The experiments of the figure page: which frame is shown from where, what is told of it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Shot:
    """A picture: the recorded pose of a frame beside the corrected one, or two moments beside each other."""

    frame: int
    target: str  # body in the middle of it, at its corrected pose
    azimuth: float  # degrees; where the eye is, seen from there
    elevation: float
    radius: float  # m, half the height of the picture
    glass: tuple[str, ...] = ()  # bodies that are drawn like glass, so that what is inside them is seen
    hidden: tuple[str, ...] = ()  # bodies that would stand in the way
    later: int | None = None  # corrected pose of this frame beside the corrected one of `frame`


@dataclass(frozen=True)
class Experiment:
    """A section of the page."""

    name: str
    title: str
    shots: tuple[Shot, ...]
    text: str  # with {frames}, {median}, {p95}, {fps}, {deepest}, {moved}, {contacts}, {impacts} filled in
    marks: tuple[tuple[int, int, str], ...] = ()  # first frame, last frame, what happens there


PAPER = (
    "The paper that the method comes from reports 30 to 60 frames a second on a 1.7 GHz Xeon of 2004, that is 17 to 33 ms a "
    "frame. Twenty years of processors lie between its times and these, so the heights of the curves say little; their shapes do."
)

EXPERIMENTS = (
    Experiment(
        "gallery",
        "A hand in an art gallery (figure 6)",
        (
            Shot(2100, "hand/index_distal", 10, 9, 0.1, glass=("table",)),
            Shot(3308, "ball", -120, 30, 0.16, glass=("ball",)),
        ),
        "Two rooms with 21 things in them, a hand of 18 parts and 4,964 triangles in rigid mode, a ball of 960 triangles, "
        "{frames} frames. In the first half the hand is idle in the air. Then it slides over the table to one side, breaks "
        "contact, slides back, and at the end sweeps through the place of the ball, which rolls away. As recorded it is up to "
        "{deepest} deep in the table; corrected it lies on it, moved by up to {moved}. The curve has the shape of the paper's: "
        "low while the hand is idle, a plateau for each slide with a dip between them, and single spikes where the ball is hit "
        "and bounces. A ball that rolls and comes to rest costs a little afterwards; the small even spikes are the first frames "
        "of the blocks of 64 that are handed to the compiled code. A frame takes {median} in the median and {p95} at the 95th "
        "percentile.",
        ((0, 1979, "idle in the air"), (1980, 2394, "slide"), (2536, 2956, "slide back"), (3302, 3320, "ball")),
    ),
    Experiment(
        "two_arms",
        "Two arms (figure 7)",
        (Shot(726, "body/right_forearm", 35, 18, 0.42),),
        "A whole body of 15 links with five chains: arms, legs, neck. The right arm swings through the left one three times, "
        "up to {deepest} deep. Only the links of the two arms are moved, each chain by the joints that bend least from the "
        "recorded posture, until nothing overlaps; trunk and legs keep their recorded poses bit for bit. {frames} frames, "
        "{median} a frame in the median, {p95} at the 95th percentile.",
        ((155, 225, "swing"), (385, 475, "swing"), (640, 750, "swing")),
    ),
    Experiment(
        "avatar_box",
        "A body touches a box (figure 2)",
        (Shot(265, "body/right_hand", -62, 18, 0.42, glass=("box",)),),
        "The hand and the forearm go up to {deepest} into the front of a box, later into its top. The angles of the arm are "
        "adjusted so that both stay outside, within the limits of the joints and the reach cone of the shoulder; the body steps "
        "back by the little that is then missing. No link is moved by more than {moved}. {frames} frames, {median} a frame in "
        "the median, {p95} at the 95th percentile.",
        ((198, 382, "front"), (612, 748, "top")),
    ),
    Experiment(
        "wall_slide",
        "A hand slides along walls",
        (Shot(700, "hand/palm", -110, 22, 0.16, glass=("wall_north", "wall_east")),),
        "The hand slides along one wall, into the corner where it is inside two walls at once, and out along the other, up to "
        "{deepest} deep. The nearest free place to the recorded one satisfies both walls together, so the corner is no "
        "special case. {frames} frames, {median} a frame in the median, {p95} at the 95th percentile.",
        ((180, 649, "north wall"), (650, 800, "corner"), (801, 1265, "east wall")),
    ),
    Experiment(
        "finger_snip",
        "A finger snips a ball",
        (
            Shot(358, "hand/index_distal", 140, 20, 0.11, later=368),
            Shot(376, "hand/index_distal", 140, 20, 0.2, later=396),
        ),
        "A fingertip flicks a ball of 2 cm near the edge of a table. The finger is not in the ball in any frame: the impact is "
        "found between two frames, the ball gets its impulse there, rolls, and falls over the edge. {impacts} impacts in "
        "{frames} frames; {median} a frame in the median, {p95} at the 95th percentile.",
        ((360, 372, "flick"),),
    ),
    Experiment(
        "hand_mug",
        "A hand closes on a mug",
        (Shot(500, "mug", -150, 28, 0.13, glass=("mug",)),),
        "Not in the paper, and harder: five fingers in chains mode close on a hollow mug whose wall is 5 mm thick, so that as "
        "recorded they stand inside of it. Each finger bends back along its own joints until its links lie on the outer face. "
        "Up to {contacts} contacts in a frame; {frames} frames, {median} a frame in the median, {p95} at the 95th percentile.",
        ((170, 330, "grip"), (400, 570, "grip, palm too")),
    ),
    Experiment(
        "hand_ball",
        "A hand closes on a ball",
        (Shot(429, "ball", -150, 28, 0.13, glass=("ball",)),),
        "The same hand on a ball that is fixed on a post: the fingers, up to {deepest} deep as recorded, come to lie on it. "
        "{frames} frames, {median} a frame in the median, {p95} at the 95th percentile.",
        ((170, 345, "grip"), (390, 575, "grip, palm too")),
    ),
)
