"""Motion: recorded or tracked joints become poses of the avatar's skeleton, from files and live."""

from ..avatar.clip import Clip
from .bvh import read_bvh, write_bvh
from .clips import CLIPS, make_clip, t_pose, take_as_rest
from .foot_lock import Soles, sole_points
from .joint_names import JOINT_SETS
from .live_stream import LiveStream, StreamFollower
from .motion import Motion
from .motion_choice import MotionOptions, choose_clip
from .pose_follower import PoseFollower
from .rest_frames import palm_directions
from .retargeting import retarget

__all__ = [
    "CLIPS",
    "JOINT_SETS",
    "Clip",
    "LiveStream",
    "Motion",
    "MotionOptions",
    "PoseFollower",
    "Soles",
    "StreamFollower",
    "bvh",
    "choose_clip",
    "clips",
    "foot_lock",
    "joint_names",
    "live_stream",
    "make_clip",
    "motion",
    "palm_directions",
    "pose_follower",
    "read_bvh",
    "retarget",
    "retargeting",
    "sole_points",
    "t_pose",
    "take_as_rest",
    "write_bvh",
]
