"""What Blender's users are told instead of core's message, where that speaks of options, keys of files or packages.

Core's messages serve the command line and scripts, too. Each is known by its template, as ``messages.json`` lists it,
and here has no other fields. What is not listed is told as core says it, without its command-line options
(:func:`.texts.without_options`).
"""

from __future__ import annotations

from collections.abc import Callable

from .texts import say

IN_BLENDER: dict[str, Callable[[], str]] = {
    # the camera's lens and the unit of depth: Capture > Load Options
    "check the depth unit (--depth-unit), the intrinsics and the mirrors' planes": lambda: say(
        "check Depth Unit and Lens under Load Options, and the mirrors"
    ),
    "it is only {distance} m from the camera, nearer than a person can be seen as a whole; check the depth unit "
    "(--depth-unit) and the intrinsics": lambda: say(
        "it is only {distance} m from the camera, too near to be seen as a whole; check Depth Unit and Lens under "
        "Load Options"
    ),
    "it looks like {mistake}, so multiply the depth unit (--depth-unit) by {factor}": lambda: say(
        "it looks like {mistake}; the right depth unit is {factor} times the one used: set Depth Unit under Load "
        "Options"
    ),
    "the file states a depth unit of {unit} m, which puts half of the readings {side} {distance} m; by their pattern "
    "it is {likely} m: if so, give that as an option (--depth-unit) or correct the file": lambda: say(
        "the file states a depth unit of {unit} m, which puts half of the readings {side} {distance} m; by their "
        "pattern it is {likely} m: if so, enter it as Depth Unit under Load Options, in millimetres"
    ),
    "the intrinsics do not fit the picture: a focal length of {focal} px is no depth camera's at {width}×{height} "
    "pixels; give those of this resolution (--intrinsics)": lambda: say(
        "the camera's lens does not fit the picture: no depth camera has a focal length of {focal} px at "
        "{width}×{height} pixels; choose another Lens, or the camera's own Lens File, under Load Options"
    ),
    "the intrinsics do not fit the picture: their centre ({cx}, {cy}) is near the edge of its {width}×{height} "
    "pixels; give those of this resolution (--intrinsics)": lambda: say(
        "the camera's lens does not fit the picture: its centre ({cx}, {cy}) is near the edge of {width}×{height} "
        "pixels; choose another Lens, or the camera's own Lens File, under Load Options"
    ),
    "no intrinsics in the capture: published ones of a {sensor} are used (f {fx} px); give your camera's own for a "
    "true scale": lambda: say(
        "the capture does not describe the camera's lens: the published one of a {sensor} is used; for a true scale "
        "choose your camera's own Lens File under Load Options"
    ),
    "no intrinsics in the folder: those the benchmark recommends are used (f 525 px)": lambda: say(
        "the capture does not describe the camera's lens: the usual one of such recordings is used"
    ),
    "{path}: the intrinsics of these {width}×{height} pixels are unknown; give them": lambda: say(
        "{path}: the camera's lens is not known at {width}×{height} pixels; choose Lens or Lens File under Load Options"
    ),
    "{path}: the intrinsics of these {width}×{height} pixels are unknown; give them, or put an {INTRINSIC_NAMES} "
    "beside the file": lambda: say(
        "{path}: the camera's lens is not known at {width}×{height} pixels; choose Lens or Lens File under Load "
        "Options, or put an {INTRINSIC_NAMES} beside the file"
    ),
    "{path}: has no calibration attached; give the intrinsics of these {width}×{height}": lambda: say(
        "{path}: does not describe the camera's lens at {width}×{height} pixels; choose Lens or Lens File under Load "
        "Options"
    ),
    "{path}: has no camera_info beside its images; give the intrinsics, or record it along": lambda: say(
        "{path}: does not describe the camera's lens; choose Lens or Lens File under Load Options"
    ),
    "{path}: is missing; it gives width, height and intrinsic_matrix of the depth camera; write it, or give a file "
    "that holds them (option “intrinsics”)": lambda: say(
        "{path}: is missing, and it describes the camera's lens; choose Lens or Lens File under Load Options"
    ),
    # left and right
    "Kinect v2's SDK exchanges left and right, and no file says so: if this picture is mirrored, say so (option "
    "“mirrored”)": lambda: say(
        "The software of Kinect v2 exchanges left and right, and no file says so: if this picture is mirrored, set "
        "Mirrored to Yes under Load Options and load it again"
    ),
    "the cloud's axes are left-handed; if left and right are exchanged, set mirrored": lambda: say(
        "left and right of the point cloud may be exchanged; if so, set Mirrored to Yes under Load Options and load "
        "it again"
    ),
    # mirrors, glass and light
    "{name}: no mirror was found: none is given, and no straight frame with the person's reflection in it is seen; "
    "pick points on each mirror's frame and save them in mirrors.json beside the capture, or elsewhere (option "
    "“mirrors”); a frame at least 3 cm wide and 10 cm off the wall is found automatically, and a mirror without one "
    "where the camera sees some of the same skin directly and in it": lambda: say(
        "{name}: no mirror was found; press Click the Frames. A frame is found automatically if it is at least 3 cm "
        "wide and 10 cm in front of the wall, and the person is seen in the mirror"
    ),
    "{names}: the glass is taken to be {thickness} mm thick, as the seams between what is seen directly and in it "
    "show; the delay and the place where it reflects are heeded. Give glass_thickness where it is known": lambda: say(
        "{names}: the glass is taken to be {thickness} mm thick, as the seams show, and this is corrected. If you "
        "know its thickness, enter it under Glass and Light"
    ),
    "{name}: what is seen twice does not quite coincide, as if its glass lay {offset} mm behind the front of its "
    "frame or were thick; measure both and give them (glass_offset, glass_thickness)": lambda: say(
        "{name}: what is seen directly and in it does not quite coincide, as if its glass lay {offset} mm behind the "
        "front of its frame, or were thick; measure both, and enter Glass Depth and Glass Thickness"
    ),
    "{share} of what is seen of the person is left out: light reaches it directly and by way of a mirror, and the "
    "floor does not show what this camera makes of that. Have more of a matt floor about the person in the picture, "
    "or give the camera's modulation (option “frequencies”)": lambda: say(
        "{share} of what is seen of the person is left out: light reaches it directly and by a mirror, which "
        "falsifies distances. Have more of a matt floor around the person in the picture, or enter the camera's "
        "Modulation under Glass and Light"
    ),
    # an object that is no person
    "the avatar would be {thickness} mm thick at a height of {height} m, as flat as a board: {cause}; if it is an "
    "object, say so (--object; in Blender “Any Object”)": lambda: say(
        "the avatar would be {thickness} mm thick at a height of {height} m, as flat as a board: {cause}. If it is "
        "an object, turn on Any Object"
    ),
    "the avatar would have {volume} l at a height of {height} m, and a person has less than {most} l: {cause}; if it "
    "is an object, say so (--object; in Blender “Any Object”)": lambda: say(
        "the avatar would have {volume} l at a height of {height} m, and a person has less than {most} l: {cause}. "
        "If it is an object, turn on Any Object"
    ),
    "the subject would be {height} m tall or more, too tall for a person: {cause}; if it is an object, say so "
    "(--object; in Blender “Any Object”)": lambda: say(
        "the subject would be {height} m tall or more, too tall for a person: {cause}. If it is an object, turn on "
        "Any Object"
    ),
    "the subject would be {height} m tall, too small for a person: {cause}; if it is an object, say so (--object; in "
    "Blender “Any Object”)": lambda: say(
        "the subject would be {height} m tall, too small for a person: {cause}. If it is an object, turn on Any Object"
    ),
    # packages that Blender's own Python has not: pip is not for it
    "colour is left out: reading video needs PyAV; install it with “pip install mirror_scan[video]”": lambda: say(
        "colour is left out: it is a video, which this Blender's Python cannot read; the avatar will have no colours"
    ),
    "images need the Python package OpenImageIO, which cannot be imported ({error}); install it with “pip install "
    "OpenImageIO”": lambda: say(
        "this Blender cannot read images: its part OpenImageIO does not start ({error}); install Blender again"
    ),
    "recording from a RealSense camera needs pyrealsense2, which cannot be imported ({error}); install it with “pip "
    "install pyrealsense2”": lambda: say(
        "a RealSense camera needs the Python package pyrealsense2, which cannot be imported ({error}); install it "
        "into Blender's own Python, as the help page Live View says"
    ),
    "recording from an Azure Kinect needs pyk4a, which cannot be imported ({error}); install Microsoft's Azure "
    "Kinect Sensor SDK and “pip install pyk4a”": lambda: say(
        "an Azure Kinect needs Microsoft's Azure Kinect Sensor SDK and the Python package pyk4a, which cannot be "
        "imported ({error}); install it into Blender's own Python, as the help page Live View says"
    ),
    "recording from an Orbbec camera needs pyorbbecsdk, which cannot be imported ({error}); install it with “pip "
    "install pyorbbecsdk2”": lambda: say(
        "an Orbbec camera needs the Python package pyorbbecsdk, which cannot be imported ({error}); install it into "
        "Blender's own Python, as the help page Live View says"
    ),
    # a file of another kind
    "{path}: is not a capture; give a folder that holds intrinsic.json and depth/*.png, or a recording (.mkv, .bag, "
    ".oni, .pcd, .ply, .r3d; see docs/formats.md)": lambda: say(
        "{path}: is not a capture of a depth camera; choose its recording, or the folder with its depth images"
    ),
    # an avatar that does not fit its texture, its skeleton or its capture any more
    "the skeleton does not stand upright and face −Y in its own axes; reconstruct in the avatar frame, and turn the "
    "object, not its mesh": lambda: say(
        "the skeleton does not stand upright and face the front (−Y) in its own axes; build the avatar again, and "
        "rotate the object instead of its mesh"
    ),
    "texture: no view sees anything of the mesh; check that mesh and views are in one frame": lambda: say(
        "texture: the capture does not show this mesh; build the avatar again from its capture"
    ),
    "the texture is of {found} triangles, and the mesh has {count}; give the texture of this mesh": lambda: say(
        "the texture belongs to a mesh of {found} triangles, and this one has {count}; press Texture again"
    ),
    "the skin weights are of {found} vertices, and the mesh has {count}; give the weights of this mesh": lambda: say(
        "the skin weights belong to a mesh of {found} vertices, and this one has {count}; delete the skeleton and "
        "add it again"
    ),
    "measurements: the skin weights are of {index} vertices, the mesh has {vertices}; give the weights of this "
    "mesh": lambda: say(
        "measurements: the skin weights belong to a mesh of {index} vertices, and this one has {vertices}; delete "
        "the skeleton and add it again"
    ),
    "texture: weights of {index} vertices do not belong to a mesh of {vertices}": lambda: say(
        "texture: the skin weights belong to a mesh of {index} vertices, and this one has {vertices}; delete the "
        "skeleton and add it again"
    ),
    "skeleton: the mesh has not the shape of a whole person who stands upright and faces -Y; check that nothing else "
    "was reconstructed with the person, and take the whole body from head to feet": lambda: say(
        "skeleton: the mesh does not have the shape of a whole person who stands upright and faces the front (−Y); "
        "see that nothing else became part of the avatar, and that no part of the body is missing"
    ),
    "measurements: the trunk has no surface where the {what} is measured": lambda: say(
        "measurements: the trunk has no surface where the {what} is measured; check that the whole body was scanned"
    ),
    "clothes: the body leaves no room for a {lower}; look at its skeleton": lambda: say(
        "clothes: the body leaves no room for a {lower}; check its skeleton"
    ),
    "nothing of it was read in {names}, and so its other side is not known ({why})": lambda: say(
        "nothing of it was seen in {names}, so its other side is not known ({why})"
    ),
    # a capture's values
    "{share} of the pixels hold a distance of {far} m and nothing lies near it: background, no reading": lambda: say(
        "{share} of the pixels hold a distance of {far} m, and nothing lies near it: they are taken for background"
    ),
    "real numbers taken for {unit}": lambda: say("the depth values are decimal numbers: they are taken for {unit}"),
    "no depth reading between {min_depth} and {max_depth} m in any of {depth} frames; check that the depth images "
    "are 16-bit millimetres and the camera was not covered": lambda: say(
        "no depth reading between {min_depth} and {max_depth} m in any of {depth} frames; check Depth Unit under "
        "Load Options, and that the camera was not covered"
    ),
    # files
    "{folder}: holds no frames of a sequence, such as {name}; make them with “mirror-scan sequence”": lambda: say(
        "{folder}: holds no frames of a sequence, such as {name}; choose another folder"
    ),
    "{path}: is not a rig file; calibrate the rig to have one": lambda: say(
        "{path}: is not a rig file; choose another file, or make one with Calibrate Rig"
    ),
    "{path}: is too large to be a rig file; calibrate the rig to have one": lambda: say(
        "{path}: is too large to be a rig file; choose another file, or make one with Calibrate Rig"
    ),
    "{path}: holds no camera or no mirrors; calibrate again": lambda: say(
        "{path}: holds no camera or no mirrors; make it again with Calibrate Rig"
    ),
}
"""By core's template, what is said in Blender."""
