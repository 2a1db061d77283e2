"""3MF: a mesh for 3D printing, in millimetres, with colours or a texture.

3MF Consortium, Core Specification 1.3 and Materials and Properties Extension 1.2.1.
"""

from __future__ import annotations

import io
import os
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ..errors import OutputError
from ..mesh import Mesh, Texture
from .atomic_files import replacing
from .images import write_png

MILLIMETRES = 1000.0
"""In a metre."""

_MODEL, _IMAGE = "3D/3dmodel.model", "3D/Textures/texture.png"
_RELATIONS = "http://schemas.openxmlformats.org/package/2006/relationships"
_TYPES = """<?xml version="1.0" encoding="UTF-8"?>
<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">
<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>
<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>
<Default Extension="png" ContentType="image/png"/>
</Types>
"""
_RELATION = f"""<?xml version="1.0" encoding="UTF-8"?>
<Relationships xmlns="{_RELATIONS}">
<Relationship Id="rel1" Target="/%s" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/%s"/>
</Relationships>
"""
_HEAD = """<?xml version="1.0" encoding="UTF-8"?>
<model unit="millimeter" xml:lang="en-US" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"\
 xmlns:m="http://schemas.microsoft.com/3dmanufacturing/material/2015/02">
<metadata name="Application">Mirror Scan</metadata>
<resources>
"""
_TEXTURE, _PROPERTY, _OBJECT = 1, 2, 3  # ids of the resources
_DATE = (1980, 1, 1, 0, 0, 0)  # the same mesh gives the same file


def write_3mf(path: str | os.PathLike, mesh: Mesh, texture: Texture | None = None) -> None:
    """Write ``mesh`` as .3mf in millimetres, at its true size.

    Parameters
    ----------
    path : path
        Ends in .3mf.
    mesh : Mesh
        In metres, Z up. Without a texture its colours go into the file, one a vertex.
    texture : Texture, optional
        Of the mesh; goes into the file as PNG.

    Raises
    ------
    OutputError
        When there are no triangles, a vertex is missing or not finite, the texture is of another mesh, or the file
        cannot be written.
    """
    path, count = Path(path), len(mesh.vertices)
    if not count or not len(mesh.triangles):
        raise OutputError("{path}: the mesh has no triangles; nothing was written", path=path)
    if not 0 <= mesh.triangles.min() <= mesh.triangles.max() < count:
        raise OutputError(
            "{path}: a triangle has a vertex that does not exist (there are {count}); nothing was written",
            path=path, count=count,
        )  # fmt: skip
    if not (np.abs(mesh.vertices) < np.finfo(np.float32).max).all():
        raise OutputError("{path}: some vertices are not finite numbers; nothing was written", path=path)
    if texture is not None and len(texture.uv) != len(mesh.triangles):
        raise OutputError(
            "{path}: the texture is of {found} triangles, and the mesh has {count}; nothing was written",
            path=path, found=len(texture.uv), count=len(mesh.triangles),
        )  # fmt: skip
    with replacing(path) as temporary, open(temporary, "wb") as file:
        file.writelines(packed_3mf(mesh, texture))


def packed_3mf(mesh: Mesh, texture: Texture | None = None) -> Iterator[bytes]:
    """The bytes of the file, in one piece."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=6) as package:

        def put(name: str, content: bytes | str) -> None:
            package.writestr(zipfile.ZipInfo(name, _DATE), content, zipfile.ZIP_DEFLATED)

        put("[Content_Types].xml", _TYPES)
        put("_rels/.rels", _RELATION % (_MODEL, "3dmodel"))
        put(_MODEL, "".join(_model(mesh, texture)))
        if texture is not None:
            put("3D/_rels/3dmodel.model.rels", _RELATION % (_IMAGE, "3dtexture"))
            package.writestr(zipfile.ZipInfo(_IMAGE, _DATE), _png(texture.image), zipfile.ZIP_STORED)
    yield buffer.getvalue()


def _model(mesh: Mesh, texture: Texture | None) -> Iterator[str]:
    """The XML of the model."""
    yield _HEAD
    triangles = np.asarray(mesh.triangles, np.int64)
    properties = None
    if texture is not None:
        places, inverse = np.unique(texture.uv.reshape(-1, 2), axis=0, return_inverse=True)
        properties = inverse.reshape(-1, 3)
        yield f'<m:texture2d id="{_TEXTURE}" path="/{_IMAGE}" contenttype="image/png" tilestyleu="clamp"'
        yield f' tilestylev="clamp"/>\n<m:texture2dgroup id="{_PROPERTY}" texid="{_TEXTURE}">\n'
        yield _rows('<m:tex2coord u="%.7f" v="%.7f"/>\n', places)  # v upwards from the lower edge, as ours
        yield "</m:texture2dgroup>\n"
    elif mesh.colors is not None:
        colors, inverse = np.unique(mesh.colors, axis=0, return_inverse=True)
        properties = inverse.reshape(-1)[triangles]
        yield f'<m:colorgroup id="{_PROPERTY}">\n'
        yield _rows('<m:color color="#%02X%02X%02X"/>\n', colors)
        yield "</m:colorgroup>\n"
    fallback = "" if properties is None else f' pid="{_PROPERTY}" pindex="0"'
    yield f'<object id="{_OBJECT}" type="model" name="Avatar"{fallback}>\n<mesh>\n<vertices>\n'
    yield _rows('<vertex x="%.5f" y="%.5f" z="%.5f"/>\n', mesh.vertices * MILLIMETRES)
    yield "</vertices>\n<triangles>\n"
    if properties is None:
        yield _rows('<triangle v1="%d" v2="%d" v3="%d"/>\n', triangles)
    else:
        line = f'<triangle v1="%d" v2="%d" v3="%d" pid="{_PROPERTY}" p1="%d" p2="%d" p3="%d"/>\n'
        yield _rows(line, np.column_stack((triangles, properties)))
    yield f'</triangles>\n</mesh>\n</object>\n</resources>\n<build>\n<item objectid="{_OBJECT}"/>\n</build>\n</model>\n'


def _rows(line: str, table: np.ndarray) -> str:
    """Each row of a table (N, K) in a line."""
    return line * len(table) % tuple(table.ravel().tolist())


def _png(image: np.ndarray) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "texture.png"
        write_png(path, image)
        return path.read_bytes()
