"""People of MakeHuman's shape space: base mesh, joints and weights, clothes. CC0.

Reads the data of github.com/makehumancommunity/mpfb2 (``src/mpfb/data``) and of makehuman-assets (``base``), both laid
into one folder. Nothing of it is shipped: :mod:`train_body_template` draws bodies here and keeps numbers only.
"""

from __future__ import annotations

import gzip
import itertools
import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from mirror_scan.core.avatar.skeleton import BONES, ENDS

BODY = 13380
"""Vertices of the body; what follows is helper geometry."""
_RACES = ("african", "asian", "caucasian")
_STEPS = {
    "gender": ("female", "male"),
    "age": ("baby", "child", "young", "old"),
    "muscle": ("minmuscle", "averagemuscle", "maxmuscle"),
    "weight": ("minweight", "averageweight", "maxweight"),
    "height": ("minheight", "", "maxheight"),
    "proportions": ("uncommonproportions", "", "idealproportions"),
    "cupsize": ("mincup", "averagecup", "maxcup"),
    "firmness": ("minfirmness", "averagefirmness", "maxfirmness"),
}
_PLACES = {"age": (0.0, 0.1875, 0.5, 1.0)}
_TIPS = {"HeadTop_End": "Head", "LeftToe_End": "LeftToeBase", "RightToe_End": "RightToeBase",
         "LeftHand_End": "LeftHandMiddle3", "RightHand_End": "RightHandMiddle3"}  # fmt: skip
_DETAILS = {
    "legs": ("upperleg-scale-vert", "lowerleg-scale-vert", "upperleg-scale-horiz", "lowerleg-scale-horiz",
             "upperleg-fat", "lowerleg-fat", "upperleg-scale-depth", "lowerleg-scale-depth"),
    "arms": ("upperarm-scale-vert", "lowerarm-scale-vert", "upperarm-scale-horiz", "lowerarm-scale-horiz",
             "upperarm-fat", "lowerarm-fat", "upperarm-scale-depth", "lowerarm-scale-depth"),
    "hands": ("hand-scale",),
    "feet": ("foot-scale",),
    "hip": ("hip-scale-vert", "hip-scale-horiz", "hip-scale-depth"),
    "torso": ("torso-scale-vert", "torso-scale-horiz", "torso-scale-depth", "torso-vshape"),
    "stomach": ("stomach-tone", "stomach-pregnant"),
    "buttocks": ("buttocks-volume",),
    "neck": ("neck-scale-vert", "neck-scale-horiz", "neck-scale-depth"),
    "head": ("head-scale-vert", "head-scale-horiz", "head-scale-depth", "head-age", "head-fat"),
}  # fmt: skip


@dataclass(frozen=True)
class Person:
    """A body in MakeHuman's own A-pose, metres, Z up, facing -Y.

    Parameters
    ----------
    vertices : np.ndarray [shape=(V, 3)]
        With helper geometry; the first ``BODY`` are the skin.
    joints, ends : np.ndarray [shape=(22, 3), (5, 3)]
        In the order of ``BONES`` and ``ENDS``.
    """

    vertices: np.ndarray
    joints: np.ndarray
    ends: np.ndarray


class MakeHuman:
    """The shape space in one folder, see the module."""

    def __init__(self, folder: Path):
        self.data = folder / "src" / "mpfb" / "data"
        self.assets = folder / "base"
        vertices, faces = read_obj(self.data / "3dobjs" / "base.obj")
        self.base = vertices
        self.faces = [face for face in faces if max(face) < BODY]
        self._targets: dict[str, tuple[np.ndarray, np.ndarray]] = {}

    @cached_property
    def triangles(self) -> np.ndarray:
        """Of the skin (T, 3)."""
        return triangulated(self.faces)

    @cached_property
    def mirror(self) -> np.ndarray:
        """Each vertex's partner on the other side (V,)."""
        pairs = np.arange(len(self.base))
        for line in (self.data / "mesh_metadata" / "hm08.mirror").read_text().splitlines():
            words = line.split()
            if len(words) >= 2:
                pairs[int(words[0])] = int(words[1])
        return pairs

    @cached_property
    def weights(self) -> np.ndarray:
        """Mixamo's weights of the skin (BODY, 22), fingers folded into the hand."""
        listed = json.loads((self.data / "rigs" / "standard" / "weights.mixamo.json").read_text())["weights"]
        dense = np.zeros((BODY, len(BONES)))
        for name, entries in listed.items():
            name = name.removeprefix("mixamorig:")
            bone = next((b for b in BONES if name == b), None) or name[: name.index("Hand") + 4]
            for vertex, weight in entries:
                if vertex < BODY:
                    dense[vertex, BONES.index(bone)] += weight
        return dense / dense.sum(axis=1, keepdims=True)

    @cached_property
    def _joint_vertices(self) -> list[np.ndarray]:
        bones = json.loads((self.data / "rigs" / "standard" / "rig.mixamo.json").read_text())["bones"]
        groups = json.loads((self.data / "mesh_metadata" / "basemesh_vertex_groups.json").read_text())

        def place(entry):
            if entry["strategy"] == "MEAN":
                return np.array(entry["vertex_indices"])
            return np.concatenate([np.arange(a, b + 1) for a, b in groups[entry["cube_name"]]])

        heads = [place(bones[f"mixamorig:{name}"]["head"]) for name in BONES]
        return heads + [place(bones[f"mixamorig:{_TIPS[name]}"]["tail"]) for name in ENDS]

    def target(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (K,) that a target moves, and how far (K, 3) [m]."""
        if name not in self._targets:
            path = self.data / "targets" / f"{name}.target.gz"
            rows = [line.split() for line in gzip.open(path, "rt") if line.strip() and not line.startswith("#")]
            index = np.array([int(row[0]) for row in rows], dtype=np.int64)
            moves = np.array([[float(value) for value in row[1:4]] for row in rows]).reshape(-1, 3)
            self._targets[name] = index, _upright(moves)
        return self._targets[name]

    def person(self, macro: dict, details: dict[str, float] | None = None) -> Person:
        """Somebody: ``macro`` has a number 0 to 1 for each of ``_STEPS`` and three shares ``race``."""
        vertices = self.base.copy()
        for name, amount in itertools.chain(_macro_targets(macro), (details or {}).items()):
            if (self.data / "targets" / f"{name}.target.gz").exists():
                index, moves = self.target(name)
                vertices[index] += amount * moves
        places = np.array([vertices[at].mean(axis=0) for at in self._joint_vertices])
        return Person(vertices, places[: len(BONES)], places[len(BONES) :])

    def mirrored(self, person: Person) -> Person:
        """The person seen in a mirror, left and right named anew."""
        vertices = person.vertices[self.mirror] * (-1, 1, 1)
        places = np.array([vertices[at].mean(axis=0) for at in self._joint_vertices])
        return Person(vertices, places[: len(BONES)], places[len(BONES) :])

    def draw(self, rng: np.random.Generator) -> Person:
        """A person of five years or more, drawn at random."""
        macro = {name: float(rng.uniform(0, 1)) for name in _STEPS}
        macro["age"] = float(rng.choice((rng.uniform(0.14, 0.4), rng.uniform(0.4, 1.0)), p=(0.3, 0.7)))
        macro["gender"] = float(rng.beta(0.4, 0.4))
        macro["height"] = float(rng.uniform(0.1, 0.9))
        macro["race"] = dict(zip(_RACES, rng.dirichlet((0.7, 0.7, 0.7)), strict=True))
        details: dict[str, float] = {}
        for folder, names in _DETAILS.items():
            for name in names:
                amount = float(np.clip(rng.normal(0, 0.12), -0.5, 0.5))
                pair = ("l-", "r-") if folder in ("legs", "arms", "hands", "feet") else ("",)
                for side in pair:
                    details[f"{folder}/{side}{name}-{'incr' if amount > 0 else 'decr'}"] = abs(amount)
        return self.person(macro, details)

    # --- clothes ---------------------------------------------------------------------------------------------------

    def outfits(self) -> Iterator[str]:
        """Names of clothes and hair, as :meth:`worn` takes them."""
        for path in sorted(self.assets.glob("*/*/*.mhclo")):
            yield f"{path.parts[-3]}/{path.parts[-2]}/{path.stem}"

    def worn(self, person: Person, outfit: str) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (V, 3) [m] and triangles (T, 3) of a piece of clothing on a person."""
        path = self.assets / f"{outfit}.mhclo"
        scale, corners, shares, offsets = np.ones(3), [], [], []
        reading = False
        for line in path.read_text(encoding="utf8", errors="replace").splitlines():
            words = line.split()
            if not words or words[0].startswith("#"):
                continue
            if words[0] in ("x_scale", "y_scale", "z_scale"):
                axis = "xyz".index(words[0][0])
                across = person.vertices[[int(words[1]), int(words[2])]]
                length = abs((across[0] - across[1])[{0: 0, 1: 2, 2: 1}[axis]])
                scale[axis] = length * 10 / float(words[3])
            elif words[0] == "verts":
                reading = True
            elif reading and words[0].isnumeric():
                if len(words) == 1:
                    corners.append([int(words[0])] * 3)
                    shares.append([1.0, 0.0, 0.0])
                    offsets.append([0.0, 0.0, 0.0])
                else:
                    corners.append([int(word) for word in words[:3]])
                    shares.append([float(word) for word in words[3:6]])
                    offsets.append([float(word) for word in words[6:9]])
            elif words[0] == "delete_verts":
                break
        moved = _upright(np.array(offsets) * scale)
        vertices = np.einsum("vk,vkj->vj", np.array(shares), person.vertices[np.array(corners)]) + moved
        _, faces = read_obj(next(path.parent.glob(f"{path.stem}.obj")))
        return vertices, triangulated(faces)


def read_obj(path: Path) -> tuple[np.ndarray, list[list[int]]]:
    """Vertices (V, 3) [m], Z up, and faces of a file of MakeHuman's."""
    vertices, faces = [], []
    for line in path.read_text(encoding="utf8", errors="replace").splitlines():
        words = line.split()
        if words and words[0] == "v":
            vertices.append([float(word) for word in words[1:4]])
        elif words and words[0] == "f":
            faces.append([int(word.split("/")[0]) - 1 for word in words[1:]])
    return _upright(np.array(vertices)), faces


def triangulated(faces: list[list[int]]) -> np.ndarray:
    """Fans (T, 3)."""
    fans = [(face[0], face[k], face[k + 1]) for face in faces for k in range(1, len(face) - 1)]
    return np.array(fans, dtype=np.int32)


def _upright(points: np.ndarray) -> np.ndarray:
    """MakeHuman's decimetres, Y up → metres, Z up."""
    return points[:, [0, 2, 1]] * (0.1, -0.1, 0.1)


def _macro_targets(macro: dict) -> Iterator[tuple[str, float]]:
    parts = {name: _between(name, macro[name]) for name in _STEPS}

    def products(*names):
        for chosen in itertools.product(*(parts[name] for name in names)):
            words, amounts = zip(*chosen, strict=True)
            if all(words):
                yield words, float(np.prod(amounts))

    for race, share in macro["race"].items():
        for (gender, age), amount in products("gender", "age"):
            yield f"macrodetails/{race}-{gender}-{age}", share * amount
    body = ("gender", "age", "muscle", "weight")
    for words, amount in products(*body):
        yield f"macrodetails/universal-{'-'.join(words)}", amount
    for words, amount in products(*body, "height"):
        yield f"macrodetails/height/{'-'.join(words)}", amount
    for words, amount in products(*body, "proportions"):
        yield f"macrodetails/proportions/{'-'.join(words)}", amount
    for words, amount in products(*body[1:], "cupsize", "firmness"):
        yield f"breast/female-{'-'.join(words)}", amount * (1 - macro["gender"])


def _between(name: str, value: float) -> list[tuple[str, float]]:
    steps = _STEPS[name]
    places = np.array(_PLACES.get(name, np.linspace(0, 1, len(steps))))
    k = int(np.clip(np.searchsorted(places, value) - 1, 0, len(steps) - 2))
    share = (value - places[k]) / (places[k + 1] - places[k])
    return [(steps[k], 1 - share), (steps[k + 1], share)]
