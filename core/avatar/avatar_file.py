"""Avatars as binary glTF (.glb, .vrm): mesh, colours, skeleton, weights and clips, written and read without Blender.

Files are in metres, Y up, facing +Z. Bones are nodes with Mixamo's names and axes, so that its clips play by name.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import CaptureError, OutputError
from ..io import read_mesh
from ..io.gltf import INDICES, VERTICES, Gltf, read_gltf, write_gltf
from ..io.images import image_of_bytes, png_bytes
from ..mesh import KIND_NAMES, Mesh, Texture
from ..mesh.normals import vertex_normals
from ..mesh.submesh import triangle_components
from ..mesh.texture import split_at_seams
from ..numeric.point_products import transform
from ..numeric.rotations import continuous, from_quaternions, quaternions
from ..numeric.srgb import from_linear, to_linear
from .bone_axes import rest_axes
from .clip import Clip
from .garment import Garment
from .pose import SkinWeights, relative_to_parents
from .skeleton import BONES, ENDS, PARENTS, Skeleton
from .skin_nodes import TO_FILE as _TO_FILE
from .skin_nodes import SkinRest, bones_above, check_finite, moved_mesh, skin_rest

PREFIX = "mixamorig:"
_VRM_NAMES = {
    "Hips": "hips", "Spine": "spine", "Spine1": "chest", "Spine2": "upperChest", "Neck": "neck", "Head": "head",
    "Shoulder": "Shoulder", "Arm": "UpperArm", "ForeArm": "LowerArm", "Hand": "Hand",
    "UpLeg": "UpperLeg", "Leg": "LowerLeg", "Foot": "Foot", "ToeBase": "Toes",
}  # fmt: skip
_VRM_LICENSE = "https://vrm.dev/licenses/1.0/"


@dataclass(frozen=True)
class Avatar:
    """What an avatar's file holds.

    Parameters
    ----------
    mesh : Mesh
        Avatar frame, in the rest pose.
    skeleton : Skeleton or None
    weights : SkinWeights or None
        Where there is a skeleton.
    clips : sequence of Clip
        Motions of the skeleton.
    texture : Texture or None
        Of the mesh's triangles.
    garments : sequence of Garment
        What the avatar wears, where there is a skeleton.
    """

    mesh: Mesh
    skeleton: Skeleton | None = None
    weights: SkinWeights | None = None
    clips: Sequence[Clip] = ()
    texture: Texture | None = None
    garments: Sequence[Garment] = ()


def write_avatar(path: str | os.PathLike, avatar: Avatar, vrm: bool = False) -> None:
    """Write ``avatar`` as .glb; ``vrm`` names the bones of VRM 1.0's humanoid, too.

    A texture lies in the file as PNG. Vertices then stand once for each place in the image, and their colours are kept
    as ``_COLOR_0``: viewers would multiply the texture with ``COLOR_0``.

    Raises
    ------
    OutputError
        When there is nothing to write, VRM is asked for without a skeleton, or the file cannot be written.
    """
    mesh = avatar.mesh
    if not len(mesh.triangles):
        raise OutputError(f"{path}: the mesh has no triangles; nothing was written")
    if not (np.abs(mesh.vertices) < np.finfo(np.float32).max).all():
        raise OutputError(f"{path}: vertices of the mesh are not finite; nothing was written")
    if vrm and avatar.skeleton is None:
        raise OutputError(f"{path}: VRM is for avatars with a skeleton; write .glb")
    body = {"name": "Avatar", "mesh": 0}
    gltf = Gltf(
        {
            "asset": {"version": "2.0", "generator": "Mirror Scan"},
            "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [body], "meshes": [{"name": "Avatar", "primitives": []}],
            "materials": [{"name": "Avatar", "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.8}}],
        }
    )  # fmt: skip
    _add_mesh(gltf, avatar)
    if avatar.skeleton is not None and avatar.weights is not None:
        _add_skeleton(gltf, avatar.skeleton)
        body["skin"] = 0
        _add_garments(gltf, avatar.garments)
        for clip in avatar.clips:
            _add_clip(gltf, avatar.skeleton, clip)
        if vrm:
            _add_vrm(gltf)
    write_gltf(path, gltf)


def read_avatar(path: str | os.PathLike) -> Avatar:
    """Read an avatar's .glb: one that :func:`write_avatar` wrote, or another with Mixamo's 22 bones.

    Raises
    ------
    CaptureError
        When it cannot be read or holds no mesh.
    """
    gltf = read_gltf(path)
    try:
        return _avatar_of(gltf, Path(path))
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, np.linalg.LinAlgError) as error:
        raise CaptureError(f"{path}: is not as glTF files are; it is damaged") from error
    except CaptureError as error:
        raise CaptureError(f"{path}: {error}") from error


def read_body(path: str | os.PathLike) -> Mesh:
    """The mesh of an avatar's .glb, or of a .ply, .obj or .stl, by the ending of its name.

    Raises
    ------
    CaptureError
        As of :func:`read_avatar` and :func:`..io.read_mesh`.
    """
    return read_avatar(path).mesh if Path(path).suffix.lower() == ".glb" else read_mesh(path)


def bone_named(name: str) -> int | None:
    """The bone that a node or a bone of that name is: Mixamo's, with or without a prefix; None when it is none."""
    plain = name.rsplit(":", 1)[-1].removeprefix("mixamorig").lstrip("_")
    return BONES.index(plain) if plain in BONES else None


# --- writing ---------------------------------------------------------------------------------------------------------


def _add_mesh(gltf: Gltf, avatar: Avatar) -> None:
    mesh, texture = avatar.mesh, avatar.texture
    triangles, rows = mesh.triangles, np.arange(len(mesh.vertices))
    if texture is not None:
        rows, places, triangles = texture.split(mesh.triangles)
    attributes = _add_surface(gltf, mesh, rows)
    if texture is not None:
        _add_places(gltf, attributes, rows, places)
        _add_image(gltf, texture.image)
    if mesh.colors is not None:
        attributes["COLOR_0" if texture is None else "_COLOR_0"] = _add_colors(gltf, mesh.colors[rows])
    if avatar.weights is not None:
        attributes |= _add_weights(gltf, avatar.weights, rows)
    if mesh.view is not None:
        attributes["_VIEW"] = gltf.add(mesh.view.astype(np.int8)[rows], VERTICES)
    whole = gltf.content["meshes"][0]
    if mesh.kind is not None:  # glTF has nothing a triangle: they stand in the order of their kinds
        triangles = triangles[np.argsort(mesh.kind, kind="stable")]
        counts = np.bincount(mesh.kind, minlength=len(KIND_NAMES))
        whole["extras"] = {"kinds": dict(zip(KIND_NAMES, counts.tolist(), strict=True))}
    indices = gltf.add(triangles.astype(np.uint32).ravel(), INDICES)
    whole["primitives"].append({"attributes": attributes, "indices": indices, "material": 0, "mode": 4})


def _add_surface(gltf: Gltf, mesh: Mesh, rows: np.ndarray) -> dict[str, int]:
    """Points and normals of the vertices ``rows`` (W,), as attributes of a primitive."""
    normals = vertex_normals(mesh.vertices, mesh.triangles) @ _TO_FILE.T
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.where(lengths > 1e-9, normals / np.maximum(lengths, 1e-9), (0.0, 1.0, 0.0)).astype(np.float32)
    points = (mesh.vertices @ _TO_FILE.T).astype(np.float32)
    return {
        "POSITION": gltf.add(points[rows], VERTICES, bounds=True), "NORMAL": gltf.add(normals[rows], VERTICES)
    }  # fmt: skip


def _add_weights(gltf: Gltf, weights: SkinWeights, rows: np.ndarray) -> dict[str, int]:
    """Weights of the vertices ``rows`` (W,), as attributes of a primitive."""
    return {
        "JOINTS_0": gltf.add(weights.index[rows], VERTICES),
        "WEIGHTS_0": gltf.add(_exact(weights.weight)[rows], VERTICES),
    }


def _add_places(gltf: Gltf, attributes: dict[str, int], rows: np.ndarray, places: np.ndarray | None) -> None:
    """Which vertex each row (W,) is, so that readers can weld them again, and its place (W, 2) in the image, if any."""
    if places is not None:  # glTF's v runs downwards
        attributes["TEXCOORD_0"] = gltf.add(np.column_stack((places[:, 0], 1 - places[:, 1])), VERTICES)
    attributes["_VERTEX"] = gltf.add(rows.astype(np.float32), VERTICES)  # exact up to 16 million


def _add_colors(gltf: Gltf, colors: np.ndarray) -> int:
    """SRGB bytes (W, 3) as linear light; the number of the accessor."""
    linear = np.full((len(colors), 4), 65535, np.uint16)
    linear[:, :3] = np.rint(65535 * to_linear(colors / 255.0))
    number = gltf.add(linear, VERTICES)
    gltf.content["accessors"][number]["normalized"] = True
    return number


def _add_garments(gltf: Gltf, garments: Sequence[Garment]) -> None:
    """Each garment as a mesh of its own on the avatar's skin; a vertex with several places in its image is repeated."""
    content = gltf.content
    for garment in garments:
        mesh = garment.mesh
        uv = np.zeros((len(mesh.triangles), 3, 2), np.float32) if garment.uv is None else garment.uv
        rows, places, corners = split_at_seams(mesh.triangles, uv)
        attributes = _add_surface(gltf, mesh, rows) | _add_weights(gltf, garment.weights, rows)
        attributes["_PINNED"] = gltf.add(garment.pinned[rows].astype(np.float32), VERTICES)
        _add_places(gltf, attributes, rows, None if garment.uv is None else places)
        if mesh.colors is not None:
            attributes["COLOR_0"] = _add_colors(gltf, mesh.colors[rows])
        content["materials"].append(
            {
                "name": garment.name, "doubleSided": True,
                "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.95},
            }
        )  # fmt: skip
        indices = gltf.add(corners.ravel().astype(np.uint32), INDICES)
        primitive = {"attributes": attributes, "indices": indices, "material": len(content["materials"]) - 1, "mode": 4}
        notes = {"tight": bool(garment.tight), "vertices": len(mesh.vertices)}
        content["meshes"].append({"name": garment.name, "primitives": [primitive], "extras": {"garment": notes}})
        content["scenes"][0]["nodes"].append(len(content["nodes"]))
        content["nodes"].append({"name": garment.name, "mesh": len(content["meshes"]) - 1, "skin": 0})


def _add_image(gltf: Gltf, image: np.ndarray) -> None:
    """The texture's image, as the colour of the material."""
    gltf.content["images"] = [
        {"name": "Avatar", "mimeType": "image/png", "bufferView": gltf.add_bytes(png_bytes(image))}
    ]
    gltf.content["samplers"] = [{"magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071}]
    gltf.content["textures"] = [{"source": 0, "sampler": 0}]
    gltf.content["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}


def _exact(weight: np.ndarray) -> np.ndarray:
    """Weights (V, 4) float32 whose rows sum to 1 in float32 too."""
    weight = weight.astype(np.float32)
    weight[:, 0] = np.float32(1.0) - weight[:, 1:].sum(axis=1, dtype=np.float32)
    return weight


def _add_skeleton(gltf: Gltf, skeleton: Skeleton) -> None:
    """Nodes of armature and bones, and the skin that binds the mesh to them."""
    nodes, axes = gltf.content["nodes"], _TO_FILE @ rest_axes(skeleton)
    joints = skeleton.joints @ _TO_FILE.T
    armature, first = len(nodes), len(nodes) + 1
    nodes.append({"name": "Armature", "children": [first]})
    bind = np.tile(np.eye(4), (len(BONES), 1, 1))
    turns = quaternions(relative_to_parents(axes))
    for bone, parent in enumerate(PARENTS):
        offset = joints[bone] if parent < 0 else axes[parent].T @ (joints[bone] - joints[parent])
        node = {"name": PREFIX + BONES[bone], "translation": offset.tolist(), "rotation": turns[bone].tolist()}
        children = [first + child for child, above in enumerate(PARENTS) if above == bone]
        if children:
            node["children"] = children
        nodes.append(node)
        bind[bone, :3, :3] = axes[bone].T
        bind[bone, :3, 3] = -axes[bone].T @ joints[bone]
    gltf.content["scenes"][0]["nodes"].append(armature)
    gltf.content["skins"] = [
        {
            "name": "Armature", "skeleton": armature, "joints": list(range(first, first + len(BONES))),
            "inverseBindMatrices": gltf.add(bind.astype(np.float32)),
            "extras": {
                "ends": {name: (_TO_FILE @ end).tolist() for name, end in zip(ENDS, skeleton.ends, strict=True)},
                "confidence": dict(zip(BONES, skeleton.confidence.tolist(), strict=True)),
            },
        }
    ]  # fmt: skip


def _add_clip(gltf: Gltf, skeleton: Skeleton, clip: Clip) -> None:
    """An animation: every bone's turn, and where the hips are."""
    first = gltf.content["skins"][0]["joints"][0]
    frames = len(clip.rotations)
    times = gltf.add((np.arange(frames) / clip.rate).astype(np.float32), bounds=True)
    world = _TO_FILE @ (clip.rotations @ rest_axes(skeleton))
    turns = continuous(quaternions(relative_to_parents(world))).astype(np.float32)
    channels, samplers = [], []

    def channel(bone: int, path: str, values: np.ndarray) -> None:
        samplers.append({"input": times, "output": gltf.add(np.ascontiguousarray(values)), "interpolation": "LINEAR"})
        channels.append({"sampler": len(samplers) - 1, "target": {"node": first + bone, "path": path}})

    places = (skeleton.joints[0] + clip.translations) @ _TO_FILE.T
    channel(0, "translation", places.astype(np.float32))
    for bone in range(len(BONES)):
        channel(bone, "rotation", turns[:, bone])
    animations = gltf.content.setdefault("animations", [])
    animations.append({"name": clip.name, "channels": channels, "samplers": samplers})


def _add_vrm(gltf: Gltf) -> None:
    first = gltf.content["skins"][0]["joints"][0]
    bones = {}
    for bone, name in enumerate(BONES):
        side = next((side for side in ("Left", "Right") if name.startswith(side)), "")
        bones[side.lower() + _VRM_NAMES[name.removeprefix(side)]] = {"node": first + bone}
    gltf.content["extensionsUsed"] = ["VRMC_vrm"]
    gltf.content["extensions"] = {
        "VRMC_vrm": {
            "specVersion": "1.0",
            "meta": {"name": "Avatar", "authors": ["Mirror Scan"], "licenseUrl": _VRM_LICENSE},
            "humanoid": {"humanBones": bones},
        }
    }


# --- reading ---------------------------------------------------------------------------------------------------------


def _avatar_of(gltf: Gltf, path: Path) -> Avatar:
    content = gltf.content
    nodes = content.get("nodes", [])
    bodies = [node for node in nodes if "mesh" in node and _garment_notes(content, node) is None]
    if not bodies:
        raise CaptureError("holds no mesh")
    body = next((node for node in bodies if "skin" in node), bodies[0])
    whole = content["meshes"][body["mesh"]]
    primitive = whole["primitives"][0]
    if primitive.get("mode", 4) != 4 or len(whole["primitives"]) != 1:
        raise CaptureError("its mesh is not one set of triangles")
    mesh = _mesh_of(gltf, primitive, whole.get("extras", {}).get("kinds"))
    texture, attributes = _texture_of(gltf, primitive, mesh), primitive["attributes"]
    if "skin" not in body or "JOINTS_0" not in attributes:
        return Avatar(mesh if texture is None else _welded(gltf, attributes, mesh)[0], texture=texture)
    skin = content["skins"][body["skin"]]
    bones = {bone: node for node in skin["joints"] if (bone := bone_named(nodes[node].get("name", ""))) is not None}
    missing = [name for bone, name in enumerate(BONES) if bone not in bones]
    if missing:
        raise CaptureError(f"its skeleton lacks the bone {PREFIX}{missing[0]}; give an avatar made by Mirror Scan")
    rest = skin_rest(gltf, skin, bones)
    bone_of = bones_above(nodes, skin["joints"], bones)
    weights, mesh = _skin_of(gltf, attributes, bone_of, rest, mesh)
    if texture is not None:
        mesh, rows = _welded(gltf, attributes, mesh)
        weights = SkinWeights(weights.index[rows], weights.weight[rows])
    extras = skin.get("extras") or {}
    ends = _ends(rest.joints, rest.axes)
    if "ends" in extras:
        said = np.array([extras["ends"][name] for name in ENDS], np.float64)
        ends = transform(check_finite(said, "the end of a bone"), rest.place)
    known = [float((extras.get("confidence") or {}).get(name, 1.0)) for name in BONES]
    skeleton = Skeleton(rest.joints, ends, np.clip(check_finite(np.array(known), "a joint's confidence"), 0.0, 1.0))
    clips = [
        clip for animation in content.get("animations", [])
        if (clip := _clip_of(gltf, animation, bones, rest)) is not None
    ]  # fmt: skip
    garments = _garments_of(gltf, body["skin"], bone_of, rest)
    return Avatar(mesh, skeleton, weights, clips, texture, garments)


def _mesh_of(gltf: Gltf, primitive: dict, kinds: dict | None) -> Mesh:
    attributes = primitive["attributes"]
    vertices = check_finite(gltf.array(attributes["POSITION"]).astype(np.float64), "the place of a vertex") @ _TO_FILE
    corners = gltf.array(primitive["indices"]) if "indices" in primitive else np.arange(len(vertices))
    triangles = corners.astype(np.int64).reshape(-1, 3)
    if len(triangles) and triangles.max() >= len(vertices):
        raise CaptureError("a triangle names a vertex that does not exist; the file is damaged")
    colors = view = kind = None
    named = next((name for name in ("_COLOR_0", "COLOR_0") if name in attributes), None)
    if named is not None:
        linear = np.clip(gltf.array(attributes[named])[:, :3].astype(np.float64), 0.0, 1.0)
        colors = np.rint(255 * from_linear(linear)).astype(np.uint8)
    if "_VIEW" in attributes:
        view = gltf.array(attributes["_VIEW"]).astype(np.int8)
    if kinds is not None and sum(kinds.values()) == len(triangles):
        kind = np.repeat(np.arange(len(KIND_NAMES), dtype=np.int8), [int(kinds[name]) for name in KIND_NAMES])
    return Mesh(vertices, triangles.astype(np.int32), colors, view, kind)


def _texture_of(gltf: Gltf, primitive: dict, mesh: Mesh) -> Texture | None:
    """The image of the primitive's material and where the triangles lie in it; None where it has none in the file."""
    attributes, content = primitive["attributes"], gltf.content
    material = content.get("materials", [{}])[primitive["material"]] if "material" in primitive else {}
    used = material.get("pbrMetallicRoughness", {}).get("baseColorTexture")
    place = f"TEXCOORD_{used.get('texCoord', 0)}" if used is not None else ""
    if used is None or place not in attributes:
        return None
    source = content["images"][content["textures"][used["index"]]["source"]]
    if "bufferView" not in source:
        return None
    image = image_of_bytes(gltf.view_bytes(source["bufferView"]))
    if image.ndim != 3 or image.shape[2] < 3 or image.dtype != np.uint8:
        return None
    uv = gltf.array(attributes[place]).astype(np.float32)[mesh.triangles]
    uv[..., 1] = np.float32(1) - uv[..., 1]
    island = triangle_components(mesh.triangles, len(mesh.vertices))[0]
    return Texture(uv, np.ascontiguousarray(image[..., :3]), island)


def _welded(gltf: Gltf, attributes: dict, mesh: Mesh) -> tuple[Mesh, np.ndarray]:
    """The mesh with one vertex where the file has several for their places in the image, and which each was (V,)."""
    if "_VERTEX" in attributes:
        number = np.rint(gltf.array(attributes["_VERTEX"]).ravel()).astype(np.int64)
    else:
        number = np.unique(mesh.vertices, axis=0, return_inverse=True)[1].ravel()
    _, rows, inverse = np.unique(number, return_index=True, return_inverse=True)
    return Mesh(
        mesh.vertices[rows],
        inverse.ravel()[mesh.triangles].astype(np.int32),
        None if mesh.colors is None else mesh.colors[rows],
        None if mesh.view is None else mesh.view[rows],
        mesh.kind,
    ), rows


def _garment_notes(content: dict, node: dict) -> dict | None:
    """What :func:`_add_garments` noted of a node's mesh; None when it is no garment."""
    return (content["meshes"][node["mesh"]].get("extras") or {}).get("garment")


def _garments_of(gltf: Gltf, skin: int, bone_of: np.ndarray, rest: SkinRest) -> list[Garment]:
    """The garments that :func:`_add_garments` wrote and that hang on the avatar's ``skin``."""
    content, found = gltf.content, []
    for node in content.get("nodes", []):
        notes = _garment_notes(content, node) if "mesh" in node and node.get("skin") == skin else None
        if notes is None:
            continue
        whole = content["meshes"][node["mesh"]]
        primitive = whole["primitives"][0]
        attributes = primitive["attributes"]
        repeated = _mesh_of(gltf, primitive, None)
        own = gltf.array(attributes["_VERTEX"]).astype(np.int64)
        first = np.full(int(notes["vertices"]), -1)
        first[own] = np.arange(len(own))
        if (first < 0).any():
            raise CaptureError("a garment in it lacks vertices; the file is damaged")
        weights, repeated = _skin_of(gltf, attributes, bone_of, rest, repeated)
        uv = None
        if "TEXCOORD_0" in attributes:
            places = gltf.array(attributes["TEXCOORD_0"])[repeated.triangles]
            uv = np.stack((places[..., 0], 1.0 - places[..., 1]), axis=-1).astype(np.float32)
        colors = None if repeated.colors is None else repeated.colors[first]
        mesh = Mesh(repeated.vertices[first], own[repeated.triangles].astype(np.int32), colors)
        pinned = gltf.array(attributes["_PINNED"]).astype(np.float32)[first]
        weights = SkinWeights(weights.index[first], weights.weight[first])
        found.append(Garment(str(whole.get("name", "Garment")), mesh, weights, pinned, bool(notes["tight"]), uv))
    return found


def _skin_of(gltf: Gltf, attributes: dict, bone_of: np.ndarray, rest: SkinRest, mesh: Mesh) -> tuple[SkinWeights, Mesh]:
    """Weights in our order of bones, and the mesh in its rest pose.

    Other joints, such as fingers, count with the bone they hang on, ``bone_of`` (J,); what hangs on none falls to none.
    """
    index = gltf.array(attributes["JOINTS_0"])
    weight = check_finite(gltf.array(attributes["WEIGHTS_0"]).astype(np.float32), "the weight of a vertex")
    if index.shape != weight.shape or len(index) != len(mesh.vertices):
        raise CaptureError("its weights are not those of its vertices; the file is damaged")
    if index.max(initial=0) >= len(bone_of):
        raise CaptureError("a vertex hangs on a joint that does not exist; the file is damaged")
    weight = np.maximum(weight, 0.0)
    mesh = moved_mesh(mesh, rest, index, weight)
    dense = np.zeros((len(weight), len(BONES) + 1), np.float32)  # the last of what is no bone
    np.add.at(dense, (np.arange(len(weight))[:, None], bone_of[index]), weight)
    bones = np.argsort(-dense[:, :-1], axis=1, kind="stable")[:, : index.shape[1]]
    weight = np.take_along_axis(dense, bones, axis=1)
    total = weight.sum(axis=1, keepdims=True)
    weight = np.where(total > 0, weight / np.maximum(total, 1e-9), (1.0, 0.0, 0.0, 0.0))
    return SkinWeights(np.where(weight > 0, bones, 0).astype(np.uint8), weight.astype(np.float32)), mesh


def _ends(joints: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Ends (5, 3) of a skeleton whose file does not say them: along the last bones, in usual shares of other bones."""
    usual = {
        "Head": ("LeftUpLeg", "LeftLeg", 0.49), "LeftHand": ("LeftForeArm", "LeftHand", 0.75),
        "RightHand": ("RightForeArm", "RightHand", 0.75), "LeftToeBase": ("LeftFoot", "LeftToeBase", 0.36),
        "RightToeBase": ("RightFoot", "RightToeBase", 0.36),
    }  # fmt: skip
    ends = []
    for name, (first, second, share) in usual.items():
        bone = BONES.index(name)
        length = np.linalg.norm(joints[BONES.index(first)] - joints[BONES.index(second)])
        ends.append(joints[bone] + share * length * axes[bone, :, 1])
    return np.array(ends)


def _clip_of(gltf: Gltf, animation: dict, bones: dict[int, int], rest: SkinRest) -> Clip | None:
    """An animation of the skeleton's bones, None when it is of something else; sampled at its own frames."""
    tracks = {}
    for channel in animation["channels"]:
        target, sampler = channel["target"], animation["samplers"][channel["sampler"]]
        if target["path"] in ("rotation", "translation") and "node" in target:
            times, values = gltf.array(sampler["input"]), gltf.array(sampler["output"])
            if sampler.get("interpolation") == "CUBICSPLINE":
                values = values[1::3]
            if len(times) != len(values) or not len(times):
                raise CaptureError("an animation has not as many values as times; the file is damaged")
            tracks[target["node"], target["path"]] = (
                check_finite(times.astype(np.float64), "a time of an animation"),
                check_finite(values.astype(np.float64), "a value of an animation"),
            )
    known = [times for (node, _), (times, _) in tracks.items() if node in bones.values()]
    if not known:
        return None
    times = max(known, key=len)
    turned = rest.armature[:3, :3] / np.cbrt(np.linalg.det(rest.armature[:3, :3]))
    local = relative_to_parents(turned.T @ rest.axes)
    world = np.empty((len(times), len(BONES), 3, 3))
    for bone, parent in enumerate(PARENTS):
        track = tracks.get((bones[bone], "rotation"))
        turns = local[bone][None] if track is None else from_quaternions(_turning(_sampled(track, times)))
        world[:, bone] = turns if parent < 0 else world[:, parent] @ turns
    rotations = turned @ world @ np.swapaxes(rest.axes, 1, 2)
    hips = tracks.get((bones[0], "translation"))
    places = np.tile(rest.joints[0], (len(times), 1))
    if hips is not None:
        places = transform(_sampled(hips, times), rest.armature)
    rate = (len(times) - 1) / (times[-1] - times[0]) if len(times) > 1 and times[-1] > times[0] else 30.0
    return Clip(str(animation.get("name", "")), round(float(rate), 3), rotations, places - rest.joints[0])


def _turning(turns: np.ndarray) -> np.ndarray:
    """The quaternions (F, 4) themselves, none of which may be 0."""
    if not (np.linalg.norm(turns, axis=1) > 1e-6).all():
        raise CaptureError("a rotation of an animation is no usable number; the file is damaged")
    return turns


def _sampled(track: tuple[np.ndarray, np.ndarray], times: np.ndarray) -> np.ndarray:
    """A track's values (F, K) at ``times``; between its own, in a straight line."""
    if len(track[0]) == len(times) and np.array_equal(track[0], times):
        return track[1]
    values = continuous(track[1]) if track[1].shape[1] == 4 else track[1]
    return np.stack([np.interp(times, track[0], column) for column in values.T], axis=1)
