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
        "this mesh does not have the shape of a whole person who stands upright and faces the front (−Y); "
        "check that nothing else became part of the avatar, and that no part of the body is missing"
    ),
    "skeleton: the mesh is {height} m high, no person's height; give one whole person who stands upright, in metres, Z "
    "up": lambda: say(
        "this mesh is {height} m high, which is no person's height; select the avatar of one whole person who stands "
        "upright (+Z)"
    ),
    "skeleton: the mesh is {breadth} m broad and only {height} m high, so nobody stands in it; give one whole "
    "person who stands upright, Z up": lambda: say(
        "this mesh is {breadth} m broad and only {height} m high, so it is no standing person; select the avatar of "
        "one whole person who stands upright (+Z)"
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
    "{file}: is {shape}×{shape2} pixels, but intrinsic.json says {width}×{height}; give the intrinsics of this "
    "resolution": lambda: say(
        "{file}: is {shape}×{shape2} pixels, but intrinsic.json describes a lens for {width}×{height}; choose the "
        "Lens, or the Lens File, of this size"
    ),
    "{path}: depth is {width}×{height} pixels, the intrinsics are for {width2}×{height2}; give the intrinsics of this "
    "resolution": lambda: say(
        "{path}: depth is {width}×{height} pixels, but the lens is for {width2}×{height2}; choose the Lens, or the "
        "Lens File, of this size"
    ),
    "{path}: depth is {width}×{height} pixels, the intrinsics are for {width2}×{height2}; width and height are "
    "exchanged, or the picture was rotated; give the intrinsics of this resolution": lambda: say(
        "{path}: depth is {width}×{height} pixels, but the lens is for {width2}×{height2}: the picture was rotated; "
        "set Rotation under Load Options, or choose the Lens File of this size"
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
    # a lens that does not fit the picture
    "{described}: is for {width}×{height} pixels, {name} has {width2}×{height2}; give the intrinsics of this "
    "resolution": lambda: say(
        "{described}: is for {width}×{height} pixels, but {name} has {width2}×{height2}; choose the Lens File of "
        "this camera and resolution under Load Options"
    ),
    "{file}: is {shape}×{shape2} pixels, but intrinsic.json says {width}×{height}: width and height are exchanged, "
    "or the picture was rotated; give the intrinsics of the picture as it is": lambda: say(
        "{file}: is {shape}×{shape2} pixels, but intrinsic.json says {width}×{height}: width and height are "
        "exchanged, or the picture was rotated. Choose the Lens File of the picture as it is under Load Options"
    ),
    "the depth map is {width}×{height}, its intrinsics are for {width2}×{height2}; use the intrinsics of this "
    "resolution": lambda: say(
        "the depth image is {width}×{height} pixels, but its lens is described for {width2}×{height2}; choose the "
        "Lens File of this resolution under Load Options"
    ),
    "the {what} is {shape}×{shape2}, its intrinsics are for {width}×{height}; use the intrinsics of this "
    "resolution": lambda: say(
        "the {what} is {shape}×{shape2} pixels, but its lens is described for {width}×{height}; choose the Lens File "
        "of this resolution under Load Options"
    ),
    "{name}: the principal point lies at {share} of the width and of the height, as if the intrinsics were those of "
    "{width}×{height} pixels; give those of this resolution, unless the picture is part of a larger": lambda: say(
        "{name}: the centre of the lens lies at {share} of the width and of the height, as if it were described for "
        "{width}×{height} pixels; choose the Lens File of this resolution, unless the picture is part of a larger one"
    ),
    "{said}, where it lies near half the size: these intrinsics look like those of a picture of double size; give "
    "the intrinsics of this resolution (halve fx, fy, cx and cy)": lambda: say(
        "{said}, where it lies near half the size: the lens seems to be described for a picture of double size. "
        "Choose the Lens File of this resolution under Load Options, or halve fx, fy, cx and cy in the file"
    ),
    "{said}, where it lies near half the size: these intrinsics look like those of a picture of half the size; give "
    "the intrinsics of this resolution (double fx, fy, cx and cy)": lambda: say(
        "{said}, where it lies near half the size: the lens seems to be described for a picture of half the size. "
        "Choose the Lens File of this resolution under Load Options, or double fx, fy, cx and cy in the file"
    ),
    "{said}: cx and cy look exchanged, as after a rotation of the picture; write cx {cy} and cy {cx}, or give the "
    "intrinsics of this picture": lambda: say(
        "{said}: cx and cy look exchanged, as after a rotation of the picture; write cx {cy} and cy {cx} in the "
        "file, or choose another Lens File under Load Options"
    ),
    "{said}: it lies at the edge or outside, and must be in pixels, near half the size{larger}; give the intrinsics "
    "of this resolution": lambda: say(
        "{said}: it lies at the edge or outside, and must be in pixels, near half the size{larger}; choose the Lens "
        "File of this resolution under Load Options"
    ),
    "intrinsics: a fisheye lens ({model}) is not supported; rectify the images": lambda: say(
        "the camera has a fisheye lens ({model}), which is not supported; record with another camera or mode"
    ),
    "{path}: its images are of a fisheye lens ({model}), which is not supported; rectify them, and give the "
    "intrinsics of the rectified ones": lambda: say(
        "{path}: its images are of a fisheye lens ({model}), which is not supported; record with another camera or mode"
    ),
    "intrinsics: focal lengths must be positive numbers, got fx={fx}, fy={fy}, cx={cx}, cy={cy}": lambda: say(
        "the focal lengths of a lens must be positive numbers, not fx={fx}, fy={fy}, with cx={cx}, cy={cy}; choose "
        "another Lens File under Load Options"
    ),
    "intrinsics: the distortion coefficients do not describe this image (they fold inside it); check their order, k1 "
    "k2 p1 p2 k3 k4 k5 k6, and that they belong to this resolution": lambda: say(
        "the distortion coefficients of the lens do not fit this image; check their order, k1 k2 p1 p2 k3 k4 k5 k6, "
        "and that they belong to this resolution"
    ),
    "intrinsics fitted from the points, within {error} px": lambda: say(
        "the camera's lens was found from the points, within {error} px"
    ),
    "{first}: {base}.xml with its intrinsics is missing; put it beside the file": lambda: say(
        "{first}: {base}.xml, which describes the camera's lens, is missing; put it beside the file, or choose Lens "
        "or Lens File under Load Options"
    ),
    "{path}: has no section <depth> with the camera's parameters": lambda: say(
        "{path}: does not describe the depth camera's lens; choose Lens or Lens File under Load Options"
    ),
    # the same in shorter sentences
    "nobody stands between the camera and the mirrors: what the camera sees fills the picture to all four sides, and "
    "no mirror shows it; clear away what is right in front of the camera, or step back until it sees all of "
    "you": lambda: say(
        "nobody stands between the camera and the mirrors: what the camera sees fills the picture to all four sides, "
        "and no mirror shows it. Clear away what is right in front of the camera, or step back until it sees all of "
        "you"
    ),
    "the path via {name} is {distance} m, but {camera} measures well only up to {range} m: {unread} of the "
    "reflection has no reading, and the rest has {noise} mm of noise; move the mirror and the camera closer to the "
    "subject, by {closer} m in total": lambda: say(
        "the path via {name} is {distance} m, but {camera} measures well only up to {range} m: {unread} of the "
        "reflection has no reading, and the rest has {noise} mm of noise. Move the mirror and the camera closer to "
        "the subject, by {closer} m in total"
    ),
    "the seams between {names} and the other views do not meet: the plane of one of these mirrors misplaces the "
    "subject by about {distance} cm; pick points on all sides of their frames again (on nothing else), or check that "
    "the mirrors are flat and have not moved": lambda: say(
        "the seams between {names} and the other views do not meet: one of these mirrors shows the subject in a "
        "wrong place, by about {distance} cm. Pick points on all sides of their frames again, on nothing else, or "
        "check that the mirrors are flat and have not moved"
    ),
    "the seams between {name} and the other views do not meet: its plane misplaces the subject by about {distance} "
    "cm; pick points on all sides of its frame again (on nothing else), or check that the mirror is flat and has not "
    "moved": lambda: say(
        "the seams between {name} and the other views do not meet: the mirror shows the subject in a wrong place, by "
        "about {distance} cm. Pick points on all sides of its frame again, on nothing else, or check that the mirror "
        "is flat and has not moved"
    ),
    "the subject moved during the burst: between its first and last frames {share} of what is seen of it moved by "
    "{median} mm (up to {largest} mm); hold still while recording, record fewer frames, or use a single "
    "frame": lambda: say(
        "the subject moved during the burst: {share} of what is seen of it moved by {median} mm (up to {largest} mm) "
        "from the first frames to the last. Hold still while recording, record fewer frames, or set Frames to 1"
    ),
    "{name} shows the floor about the subject {distance} cm {side} where the camera sees it: its plane leans "
    "otherwise than the mirror does; pick points on all sides of its frame again, or check that the mirror has not "
    "moved": lambda: say(
        "{name} shows the floor around the subject {distance} cm {side} where the camera sees it, so the mirror "
        "leans differently. Pick points on all sides of its frame again, or check that the mirror has not moved"
    ),
    "{name}: hangs on a wall, and no frame projects in front of the wall: the wall's plane was taken for the "
    "mirror's, and its reflection is misplaced by twice the distance from the wall to the glass; strips of paper or "
    "tape, 3 cm wide, on the edges of the glass would show where the glass is": lambda: say(
        "{name}: hangs on a wall, and no frame projects in front of the wall. The wall's plane was taken for the "
        "mirror's, so its reflection is misplaced by twice the distance from the wall to the glass. Put strips of "
        "paper or tape, 3 cm wide, on the edges of the glass: they show where it is"
    ),
    "{name}: only {near} of {count} picked points lie in one plane, the others up to {max} m off it; pick on the "
    "frame itself, not on the glass. If the mirror has no frame and does not hang on a wall, put strips of paper or "
    "tape, 3 cm wide, along its edges": lambda: say(
        "{name}: only {near} of {count} picked points lie in one plane, the others up to {max} m off it. Pick on the "
        "frame itself, not on the glass. If the mirror has no frame and does not hang on a wall, put strips of paper "
        "or tape, 3 cm wide, along its edges"
    ),
    "{name}: {what} by {uneven} mm, far more than the camera's noise, so that its reflection may be off by {error} "
    "mm; see that nothing covers or bends the frame and that every pick is on it, or, for a mirror on a wall, give "
    "it a frame that stands 2 cm off the wall": lambda: say(
        "{name}: {what} by {uneven} mm, far more than the camera's noise, so its reflection may be off by {error} "
        "mm. See that nothing covers or bends the frame, and that every pick is on it. For a mirror on a wall, use a "
        "frame that stands 2 cm off the wall"
    ),
    "{name}: the plane through the picks is seen edge-on, so that nothing could be seen in it; pick on the frame "
    "itself, on at least two of its sides, not on the glass or on something in front of it": lambda: say(
        "{name}: the plane through the picked points is seen edge-on, so nothing could be seen in the mirror. Pick "
        "points on the frame itself, on at least two of its sides, not on the glass or on something in front of it"
    ),
    "{name}: the plane through its picks does not look like a mirror's: almost no frame lies in it, or what is seen "
    "in it would be where the camera sees empty space; pick again, on its frame only": lambda: say(
        "{name}: the picked points do not seem to lie on a mirror's frame: almost no frame lies in their plane, or "
        "what is seen in it would be where the camera sees empty space. Pick again, on its frame only"
    ),
    "{name}: no frame is visible; its plane was computed from the person it shows, and its reflection may be "
    "misplaced by {error} mm; strips of paper or tape, 3 cm wide, along its edges would reduce that": lambda: say(
        "{name}: no frame is visible. Its plane was computed from the person it shows, and its reflection may be "
        "misplaced by {error} mm. Strips of paper or tape, 3 cm wide, along its edges would reduce that"
    ),
    "{what} between the camera and the mirrors: no connected figure is seen directly within {reach} m of where the "
    "mirrors look; stand where both mirrors show you, 2 to 3 m from the camera": lambda: say(
        "{what} between the camera and the mirrors: no connected figure is seen directly within {reach} m of where "
        "the mirrors look. Stand where both mirrors show you, 2 to 3 m from the camera"
    ),
}
"""By core's template, what is said in Blender."""
