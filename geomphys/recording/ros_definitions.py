"""Definitions of the standard ROS messages, used where the schema in a log is empty, corrupt or IDL (ros2idl).

They are used where a schema is empty, corrupt or written in IDL (ros2idl).
"""

from __future__ import annotations

_FIELDS = {
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
    "geometry_msgs/Transform": "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation",
    "geometry_msgs/Twist": "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular",
    "geometry_msgs/PoseWithCovariance": "geometry_msgs/Pose pose\nfloat64[36] covariance",
    "geometry_msgs/TwistWithCovariance": "geometry_msgs/Twist twist\nfloat64[36] covariance",
    "geometry_msgs/PoseStamped": "std_msgs/Header header\ngeometry_msgs/Pose pose",
    "geometry_msgs/PoseWithCovarianceStamped": "std_msgs/Header header\ngeometry_msgs/PoseWithCovariance pose",
    "geometry_msgs/TransformStamped": (
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform"
    ),
    "geometry_msgs/PoseArray": "std_msgs/Header header\ngeometry_msgs/Pose[] poses",
    "nav_msgs/Odometry": (
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n"
        "geometry_msgs/TwistWithCovariance twist"
    ),
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "sensor_msgs/JointState": "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort",
}
"""Type -> its fields, in ROS 2."""
ROS1_HEADER = "uint32 seq\ntime stamp\nstring frame_id"
_ROOTS = (
    "sensor_msgs/JointState", "geometry_msgs/PoseStamped", "geometry_msgs/PoseWithCovarianceStamped",
    "geometry_msgs/TransformStamped", "geometry_msgs/Pose", "geometry_msgs/Transform", "geometry_msgs/PoseArray",
    "nav_msgs/Odometry", "tf2_msgs/TFMessage",
)  # fmt: skip


def joined(types: dict[str, str], root: str) -> str:
    """One text of a type's fields and of those of the types in it, as schemas have it."""
    found, seen = [root], {root}
    for name in found:
        kinds = (line.split()[0].partition("[")[0] for line in types[name].splitlines())
        new = dict.fromkeys(k for k in kinds if k in types and k not in seen)
        found += new
        seen.update(new)
    bar = "\n" + "=" * 80 + "\n"
    return bar.join(types[n] if n == root else f"MSG: {n}\n{types[n]}" for n in found) + "\n"


def _full(name: str) -> str:
    return name.replace("/", "/msg/")


STANDARD_TYPES = {_full(name): joined(_FIELDS, name) for name in _ROOTS}
"""Full name -> definition in ROS 2."""
ROS1_TYPES = {_full(name): joined({**_FIELDS, "std_msgs/Header": ROS1_HEADER}, name) for name in _ROOTS}
"""Full name -> definition in ROS 1."""
