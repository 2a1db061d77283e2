"""Small files of the capture formats and PLY, written from their published descriptions; for tests only.

Encoders are the plainest that is valid: what they write is read back by ours and, where there is one, by an
independent reader.
"""

from __future__ import annotations

import io
import json
import math
import struct
import zipfile

import numpy as np
from mirror_scan.core.errors import MirrorScanError
from mirror_scan.core.io.images import openimageio, write_png


def scene(width=64, height=48, seed=0):
    """Depth (H, W) uint16 mm with a step, a slope, noise and gaps, and a colour image (H, W, 3) uint8."""
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[:height, :width]
    depth = 1500 + 3 * u + 2 * v + rng.integers(-4, 5, (height, width))
    depth[height // 4 : height // 2, width // 4 : width // 2] -= 600
    depth[rng.random((height, width)) < 0.1] = 0
    color = np.stack((u * 3 % 256, v * 5 % 256, (u + v) % 256), axis=-1)
    return depth.astype(np.uint16), color.astype(np.uint8)


def cloud_of(depth_mm, fx, fy, cx, cy):
    """Points (H, W, 3) float32 m of a depth image; nan without a reading."""
    height, width = depth_mm.shape
    v, u = np.mgrid[:height, :width]
    z = np.where(depth_mm > 0, depth_mm / 1000, np.nan)
    return np.stack(((u - cx) / fx * z, (v - cy) / fy * z, z), axis=-1).astype(np.float32)


def lzf_compress(data: bytes) -> bytes:
    """LZF with runs of one distance only: literals, and copies of the byte four back."""
    out, literal, i = bytearray(), bytearray(), 0

    def flush():
        for k in range(0, len(literal), 32):
            part = literal[k : k + 32]
            out.append(len(part) - 1)
            out.extend(part)
        literal.clear()

    while i < len(data):
        run = 0
        while i >= 4 and i + run < len(data) and run < 264 and data[i + run] == data[i + run - 4]:
            run += 1
        if run >= 3:
            flush()
            if run - 2 < 7:
                out.append((run - 2) << 5)
            else:
                out += bytes((7 << 5, run - 9))
            out.append(3)
            i += run
        else:
            literal.append(data[i])
            i += 1
    flush()
    return bytes(out)


def pcd(cloud, color, kind):
    """An organized .pcd; ``kind`` ascii, binary or binary_compressed."""
    height, width = cloud.shape[:2]
    packed = (color.astype(np.uint32) << np.uint32([16, 8, 0])).sum(axis=2, dtype=np.uint32)
    header = (
        f"# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z rgba\nSIZE 4 4 4 4\nTYPE F F F U\n"
        f"COUNT 1 1 1 1\nWIDTH {width}\nHEIGHT {height}\nVIEWPOINT 0 0 0 1 0 0 0\n"
        f"POINTS {width * height}\nDATA {kind}\n"
    ).encode()
    columns = [np.ascontiguousarray(cloud[..., i], "<f4").ravel() for i in range(3)] + [packed.astype("<u4").ravel()]
    if kind == "ascii":
        rows = zip(*[c.tolist() for c in columns], strict=True)
        return header + "\n".join(f"{x!r} {y!r} {z!r} {c}" for x, y, z, c in rows).encode() + b"\n"
    if kind == "binary":
        return header + np.rec.fromarrays(columns).tobytes()
    raw = b"".join(c.tobytes() for c in columns)
    packed = lzf_compress(raw)
    return header + struct.pack("<II", len(packed), len(raw)) + packed


def ply(cloud, color, kind="binary_little_endian", range_grid=False):
    """An organized .ply: a vertex a pixel with nan, or PCL's range grid of the valid ones."""
    height, width = cloud.shape[:2]
    points, colors = cloud.reshape(-1, 3), color.reshape(-1, 3)
    good = np.isfinite(points).all(axis=1)
    said = ""
    if range_grid:
        points, colors = points[good], colors[good]
        said = f"obj_info num_cols {width}\nobj_info num_rows {height}\n"
    text = (
        f"ply\nformat {kind} 1.0\n{said}element vertex {len(points)}\nproperty float x\nproperty float y\n"
        "property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
    )
    if range_grid:
        text += f"element range_grid {width * height}\nproperty list uchar int vertex_indices\n"
    text += "end_header\n"
    if kind == "ascii":
        rows = zip(points.tolist(), colors.tolist(), strict=True)
        return (text + "\n".join(" ".join(map(str, (*p, *c))) for p, c in rows) + "\n").encode()
    order = "<" if kind == "binary_little_endian" else ">"
    record = np.zeros(len(points), [("p", order + "f4", 3), ("c", "u1", 3)])
    record["p"], record["c"] = points, colors
    body = record.tobytes()
    if range_grid:
        numbers = iter(range(len(points)))
        body += b"".join(struct.pack(order + "Bi", 1, next(numbers)) if ok else b"\0" for ok in good)
    return text.encode() + body


def encode_16z(values, table):
    """OpenNI's depth codec: 16zT with a table of the used values, 16zP without."""
    values = np.asarray(values, np.uint16).ravel()
    out = bytearray()
    if table:
        used, values = np.unique(values, return_inverse=True)
        out += struct.pack("<H", len(used)) + used.astype("<u2").tobytes()
    values = [int(v) for v in values]
    out += struct.pack("<H", values[0])
    last, half, zeros = values[0], None, 0

    def flush_zeros():
        nonlocal zeros
        while zeros:
            count = min(zeros, 14)
            out.append(0xE0 + count)
            zeros -= count

    for value in values[1:]:
        difference = last - value
        last = value
        if abs(difference) <= 6:
            if half is None:
                half = difference + 6
            elif (half, difference) == (6, 0):
                zeros, half = zeros + 1, None
            else:
                flush_zeros()
                out.append(half << 4 | difference + 6)
                half = None
        else:
            flush_zeros()
            out.append(0xFF if half is None else half << 4 | 0x0F)
            half = None
            out += bytes((difference + 192,)) if abs(difference) <= 63 else struct.pack(">H", value)
    flush_zeros()
    if half is not None:
        out.append(half << 4 | 0x0D)
    return bytes(out)


def oni(frames, color=None, codec=b"16zT", color_codec=b"NONE", fov=(1.0145, 0.7898), properties=(), old=False):
    """An OpenNI recording of depth frames (H, W) uint16 and one colour image (bytes when it is JPEG)."""
    height, width = frames[0].shape
    out = bytearray(b"NI10" + struct.pack("<BBHIQI", 1, 0, 0 if old else 1, 5 if old else 0, 0, 2))

    def record(kind, node, fields, payload=b""):
        size = (24 if old else 28) + len(fields)
        out.extend(b"NIR\0" + struct.pack("<IIII", kind, node, size, len(payload)))
        out.extend(struct.pack("<I" if old else "<Q", 0) + fields + payload)

    def text(value):
        return struct.pack("<I", len(value) + 1) + value.encode() + b"\0"

    def number(name, value):
        return 0x03, text(name) + struct.pack("<IQ", 8, value)

    def general(name, raw):
        return 0x06, text(name) + struct.pack("<I", len(raw)) + raw

    mode = struct.pack("<III", width, height, 30)
    streams = [
        (1, 2, codec, [general("xnMapOutputMode", mode), general("xnFOV", struct.pack("<2d", *fov)), *properties])
    ]
    if color is not None:
        said = [general("xnMapOutputMode", mode), number("oniPixelFormat", 200)]
        streams.append((2, 3, color_codec, said))
    for node, kind, compression, said in streams:
        record(
            0x0C if old else 0x0D,
            node,
            text(f"node{node}") + struct.pack("<i4sIQQ", kind, compression, 1, 0, 0) + b"\0" * 8,
        )
        for type_, fields in said:
            record(type_, node, fields)
        record(0x09, node, b"")
    for i, frame in enumerate(frames):
        payload = frame.astype("<u2").tobytes() if codec == b"NONE" else encode_16z(frame, codec == b"16zT")
        record(0x0A, 1, struct.pack("<QI", 33_000 * i, i), payload)
        if color is not None and i == 0:
            record(
                0x0A, 2, struct.pack("<QI", 33_000 * i + 5, i), color if isinstance(color, bytes) else color.tobytes()
            )
    record(0x0B, 0, b"")
    return bytes(out)


def oni_number(name, value):
    """A whole-number property for :func:`oni`."""
    name = name.encode() + b"\0"
    return 0x03, struct.pack("<I", len(name)) + name + struct.pack("<IQ", 8, value)


def element(kind: int, body: bytes) -> bytes:
    """One EBML element."""
    raw = kind.to_bytes((kind.bit_length() + 7) // 8, "big")
    return raw + (len(body) | 1 << 56).to_bytes(8, "big") + body


def mkv(frames, color=None, calibration=None, color_kind=b"BGRA", color_size=None, live=False):
    """An Azure Kinect recording of depth frames (H, W) uint16 mm; colour as raw bytes of its kind."""
    height, width = frames[0].shape

    def uint(kind, value):
        return element(kind, value.to_bytes(8, "big"))

    def bitmap(w, h, code):
        return struct.pack("<IiiHH4sIiiII", 40, w, h, 1, 16, code, 0, 0, 0, 0, 0)

    def track(number, uid, name, code, w, h):
        video = element(0xE0, uint(0xB0, w) + uint(0xBA, h))
        return element(
            0xAE,
            uint(0xD7, number) + uint(0x83, 1) + uint(0x73C5, uid) + element(0x536E, name)
            + element(0x86, b"V_MS/VFW/FOURCC") + element(0x63A2, bitmap(w, h, code)) + video,
        )  # fmt: skip

    tracks = track(1, 101, b"DEPTH", b"b16g", width, height)
    if color is not None:
        tracks += track(2, 102, b"COLOR", color_kind, *color_size)

    def tag(name, value, uid=0):
        return element(
            0x7373, element(0x63C0, uint(0x63C5, uid)) + element(0x67C8, element(0x45A3, name) + element(0x4487, value))
        )

    body = element(0x1549A966, uint(0x2AD7B1, 1_000_000)) + element(0x1654AE6B, tracks)
    if calibration is not None:
        text = json.dumps(calibration).encode()
        body += element(0x1941A469, element(0x61A7, element(0x466E, b"calibration.json") + element(0x465C, text)))
    body += element(
        0x1254C367, tag(b"K4A_DEPTH_TRACK", b"101", 101) + tag(b"K4A_CALIBRATION_FILE", b"calibration.json")
    )
    clusters = b""
    for i, frame in enumerate(frames):
        blocks = uint(0xE7, 33 * i) + element(0xA3, b"\x81\0\0\x80" + frame.astype(">u2").tobytes())
        if color is not None and i == 0:
            blocks += element(0xA0, element(0xA1, b"\x82\0\x01\0" + color))
        if live:  # size unknown, as a recorder writes before it knows
            clusters += (0x1F43B675).to_bytes(4, "big") + b"\x01" + b"\xff" * 7 + blocks
        else:
            clusters += element(0x1F43B675, blocks)
    return element(0x1A45DFA3, element(0x4282, b"matroska")) + element(0x18538067, body + clusters)


def calibration(fx=0.49, shift=(-0.032, -0.002, 0.004)):
    """An Azure Kinect calibration with mild lenses."""

    def camera(purpose, f, place):
        parameters = [0.5, 0.5, f, f, 0.05, -0.02, 0.001, 0.01, -0.005, 0.0005, 0, 0, 1e-4, -1e-4]
        return {
            "Purpose": f"CALIBRATION_CameraPurpose{purpose}", "SensorWidth": 4096, "SensorHeight": 3072,
            "Intrinsics": {"ModelParameters": parameters},
            "Rt": {"Rotation": [1, 0, 0, 0, 1, 0, 0, 0, 1], "Translation": list(place)},
        }  # fmt: skip

    return {"CalibrationInformation": {"Cameras": [camera("Depth", fx, (0, 0, 0)), camera("PhotoVideo", 0.5, shift)]}}


def realsense_bag(
    frames, color=None, compression="none", unit=0.001, intrinsics=(), model="Brown Conrady", indexed=True,
    color_shift=(0, 0, 0),
):  # fmt: skip
    """A ROS 1 bag with the SDK's topics; ``compression`` none, bz2 or lz4. Colour may be larger, from elsewhere."""

    def text(value):
        return struct.pack("<I", len(value)) + value

    def image(pixels, encoding):
        raw = pixels.tobytes()
        head = struct.pack("<III", 0, 0, 0) + text(b"0") + struct.pack("<II", *pixels.shape[:2]) + text(encoding)
        return head + struct.pack("<BI", 0, len(raw) // pixels.shape[0]) + text(raw)

    def info(pixels):
        height, width = pixels.shape[:2]
        f = 60.0 * width / frames[0].shape[1]
        k = (f, 0, width / 2, 0, f + 1, height / 2, 0, 0, 1)
        return (
            struct.pack("<III", 0, 0, 0) + text(b"") + struct.pack("<II", height, width) + text(model.encode())
            + struct.pack("<I", len(intrinsics)) + struct.pack(f"<{len(intrinsics)}d", *intrinsics)
            + struct.pack("<9d", *k)
            + bytes(8 * 21) + bytes(8 + 17)
        )  # fmt: skip

    base, paint = b"/device_0/sensor_0/Depth_0", b"/device_0/sensor_1/Color_0"
    still = struct.pack("<7d", 0, 0, 0, 0, 0, 0, 1)
    messages = [
        (base + b"/info/camera_info", b"sensor_msgs/CameraInfo", info(frames[0])),
        (b"/device_0/sensor_0/option/Depth_Units/value", b"std_msgs/Float32", struct.pack("<f", unit)),
        (b"/device_0/info", b"diagnostic_msgs/KeyValue", text(b"Name") + text(b"Intel RealSense D455")),
        (base + b"/tf/0", b"geometry_msgs/Transform", still),
    ]
    messages += [(base + b"/image/data", b"sensor_msgs/Image", image(f.astype("<u2"), b"mono16")) for f in frames]
    if color is not None:
        messages += [
            (paint + b"/info/camera_info", b"sensor_msgs/CameraInfo", info(color)),
            (paint + b"/tf/0", b"geometry_msgs/Transform", struct.pack("<7d", *color_shift, 0, 0, 0, 1)),
            (paint + b"/image/data", b"sensor_msgs/Image", image(color, b"rgb8")),
        ]

    def record(fields, body):
        head = b"".join(struct.pack("<I", len(k) + 1 + len(v)) + k + b"=" + v for k, v in fields)
        return struct.pack("<I", len(head)) + head + struct.pack("<I", len(body)) + body

    topics, chunk, places = {}, bytearray(), {}
    for i, (topic, kind, body) in enumerate(messages):
        if topic not in topics:
            number = topics[topic] = struct.pack("<I", len(topics))
            chunk += record(
                [(b"op", b"\7"), (b"conn", number), (b"topic", topic)],
                b"".join(struct.pack("<I", len(f)) + f for f in (b"topic=" + topic, b"type=" + kind)),
            )
        time = struct.pack("<II", 1, i)
        places.setdefault(topics[topic], []).append(time + struct.pack("<I", len(chunk)))
        chunk += record([(b"op", b"\2"), (b"conn", topics[topic]), (b"time", time)], body)
    packed = bytes(chunk)
    if compression == "bz2":
        import bz2

        packed = bz2.compress(packed)
    elif compression == "lz4":
        import lz4.frame

        packed = lz4.frame.compress(packed)
    out = b"#ROSBAG V2.0\n" + record([(b"op", b"\3"), (b"index_pos", bytes(8))], b" " * 100)
    size = struct.pack("<I", len(chunk))
    out += record([(b"op", b"\5"), (b"compression", compression.encode()), (b"size", size)], packed)
    if indexed:
        for number, entries in places.items():
            head = [(b"op", b"\4"), (b"ver", struct.pack("<I", 1)), (b"conn", number),
                    (b"count", struct.pack("<I", len(entries)))]  # fmt: skip
            out += record(head, b"".join(entries))
    return out


def realsense_db3(path, frames, color=None, unit=0.001, color_shift=(0, 0, 0)):
    """A recording of RealSense's SDK since 2.57, as an SQLite file at ``path``. Colour may be larger."""
    import sqlite3

    def text(value):
        return b"\0\1\0\0" + struct.pack("<I", len(value) + 1) + value.encode() + b"\0"

    def png(pixels):
        write_png(path.with_suffix(".png"), pixels)
        return b"\0\1\0\0" + bytes(40) + path.with_suffix(".png").read_bytes()

    def info(pixels):
        height, width = pixels.shape[:2]
        f = 60 * width // frames[0].shape[1]
        intrinsics = "model=Brown Conrady;coeffs=0,0,0,0,0"
        return f"width={width};height={height};fx={f};ppx={width / 2};fy={f + 1};ppy={height / 2};{intrinsics}"

    def place(shift):
        return f"rotation=1,0,0,0,1,0,0,0,1;translation={','.join(map(str, shift))}"

    base, paint = "/device_0/sensor_0/Depth_0", "/device_0/sensor_1/Color_0"
    messages = [
        ("/device_0/info", text("Name=Intel RealSense D435I")), (f"{base}/camera_info", text(info(frames[0]))),
        ("/device_0/sensor_0/option/Depth_Units/value", text(f"{unit:f}")),
        (f"{base}/tf/ref_1", text(place((0, 0, 0)))),
    ]  # fmt: skip
    messages += [(f"{base}/image/data/compressedDepth", png(frame)) for frame in frames]
    if color is not None:
        messages += [(f"{paint}/camera_info", text(info(color))), (f"{paint}/tf/ref_1", text(place(color_shift)))]
        messages += [(f"{paint}/image/data/compressed", png(color))]
    names = list(dict.fromkeys(name for name, _ in messages))
    with sqlite3.connect(path) as file:
        file.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL)")
        file.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)")
        file.executemany("INSERT INTO topics VALUES(?, ?)", enumerate(names))
        rows = ((names.index(name), i, body) for i, (name, body) in enumerate(messages))
        file.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)", rows)
    file.close()
    path.with_suffix(".png").unlink()
    return path


def pclzf(pixels, kind):
    """A .pclzf of depth16 (H, W) uint16 or rgb24 (H, W, 3) uint8."""
    height, width = pixels.shape[:2]
    raw = pixels.astype("<u2").tobytes() if kind == "depth16" else pixels.transpose(2, 0, 1).tobytes()
    packed = lzf_compress(raw)
    return struct.pack("<5sII16sII", b"PCLZF", width, height, kind.encode().ljust(16), len(packed), len(raw)) + packed


def pclzf_xml(f, cx, cy):
    """The grabber's parameters."""
    values = (("focal_length_x", f), ("focal_length_y", f), ("principal_point_x", cx), ("principal_point_y", cy))
    inner = "".join(f"<{name}>{value}</{name}>\n" for name, value in values)
    return f"<rgb>\n{inner.replace(str(f), '1')}</rgb>\n<depth>\n{inner}</depth>\n"


def fakenect(folder, frames, color=None, plane=None):
    """A recording of libfreenect's of raw (480, 640) frames."""
    folder.mkdir(parents=True, exist_ok=True)
    names = []
    for i, frame in enumerate(frames):
        names.append(f"d-{1300000000 + 0.033 * i:.6f}-{i * 2000}.pgm")
        (folder / names[-1]).write_bytes(b"P5 640 480 65535\n" + frame.astype("<u2").tobytes())
        if color is not None:
            names.append(f"r-{1300000000 + 0.033 * i + 0.01:.6f}-{i * 2000}.ppm")
            (folder / names[-1]).write_bytes(b"P6 640 480 255\n" + color.tobytes())
    names.append("a-1300000000.010000-5.dump")
    (folder / "INDEX.txt").write_text("\n".join(names) + "\n")
    if plane is not None:
        keys = "reference_distance", "reference_pixel_size", "dcmos_emitter_distance", "dcmos_rcmos_distance"
        section = dict(zip(keys, plane[:4], strict=True))
        (folder / "device.json").write_text(
            json.dumps({"reg_info": {"zero_plane_info": section}, "const_shift": plane[4]})
        )
    return folder


def tum(folder, frames_mm, color, apart=0.004):
    """A TUM RGB-D sequence."""
    (folder / "depth").mkdir(parents=True)
    (folder / "rgb").mkdir()
    lists = {"depth": ["# depth maps"], "rgb": ["# color images"]}
    for i, frame in enumerate(frames_mm):
        time = 1305031102.16 + i / 30
        write_png(folder / "depth" / f"{time:.6f}.png", frame * np.uint16(5))
        lists["depth"].append(f"{time:.6f} depth/{time:.6f}.png")
        write_png(folder / "rgb" / f"{time + apart:.6f}.png", np.roll(color, i, axis=1))
        lists["rgb"].append(f"{time + apart:.6f} rgb/{time + apart:.6f}.png")
    for name, lines in lists.items():
        (folder / f"{name}.txt").write_text("\n".join(lines) + "\n")
    return folder


def sun(folder, depth_mm, color, f=520.0):
    """A SUN RGB-D scene."""
    height, width = depth_mm.shape
    (folder / "depth").mkdir(parents=True)
    (folder / "image").mkdir()
    write_png(folder / "depth" / "0001.png", (depth_mm << 3) | (depth_mm >> 13))
    write_png(folder / "image" / "0001.png", color)
    (folder / "intrinsics.txt").write_text(f"{f} 0 {width / 2} 0 {f} {height / 2} 0 0 1\n")
    return folder


def r3d(frames_m, color_jpg=None, confidence=None, size=None, extra=None):
    """A Record3D file; depth compressed by Apple's own coder."""
    import liblzfse

    height, width = frames_m[0].shape
    w, h = size or (width * 4, height * 4)
    about = {"w": w, "h": h, "dw": width, "dh": height, "fps": 60, "K": [200.0, 0, 0, 0, 201.0, 0, w / 2, h / 2, 1]}
    raw = io.BytesIO()
    with zipfile.ZipFile(raw, "w") as archive:
        archive.writestr("metadata", json.dumps(about | (extra or {})))
        for i, frame in enumerate(frames_m):
            archive.writestr(f"rgbd/{i}.depth", liblzfse.compress(frame.astype("<f4").tobytes()))
            if confidence is not None:
                archive.writestr(f"rgbd/{i}.conf", liblzfse.compress(confidence.tobytes()))
            if color_jpg is not None:
                archive.writestr(f"rgbd/{i}.jpg", color_jpg)
    return raw.getvalue()


def stray(folder, frames_mm, confidence, kind="npy", down=(0.0, 1.0, 0.0)):
    """A Stray Scanner folder without video; ``down`` is gravity in the camera frame."""
    (folder / "depth").mkdir(parents=True)
    (folder / "confidence").mkdir()
    for i, frame in enumerate(frames_mm):
        if kind == "npy":
            np.save(folder / "depth" / f"{i:06d}.npy", frame)
        else:
            write_png(folder / "depth" / f"{i:06d}.png", frame)
        write_png(folder / "confidence" / f"{i:06d}.png", confidence)
    (folder / "camera_matrix.csv").write_text("1430.0, 0.0, 960.0\n0.0, 1431.0, 720.0\n0.0, 0.0, 1.0\n")
    x, y, z, w = quaternion_of_down(np.asarray(down, float))
    lines = ["timestamp, frame, x, y, z, qx, qy, qz, qw"]
    lines += [f"{i / 60}, {i:06d}, 0, 0, 0, {x}, {y}, {z}, {w}" for i in range(len(frames_mm))]
    (folder / "odometry.csv").write_text("\n".join(lines) + "\n")
    return folder


def quaternion_of_down(down):
    """x, y, z, w of a rotation that takes ``down`` to minus y, ARKit's downward."""
    from scipy.spatial.transform import Rotation

    rotation, _ = Rotation.align_vectors([[0.0, -1.0, 0.0]], [down / math.hypot(*down)])
    return rotation.as_quat()


DEPTH, COLOR = scene()
METRES = np.divide(DEPTH, 1000, dtype=np.float32)
CAMERA = (60.0, 61.0, 31.5, 24.0)


def saved(folder, name, data):
    path = folder / name
    path.write_bytes(data)
    return path


def jpeg(folder, image):
    """A JPEG file's bytes, by OpenImageIO."""
    oiio = openimageio()
    path = folder / "any.jpg"
    spec = oiio.ImageSpec(image.shape[1], image.shape[0], 3, oiio.UINT8)
    spec["Compression"] = "jpeg:100"
    output = oiio.ImageOutput.create("jpeg")
    assert output.open(str(path), spec) and output.write_image(image) and output.close()
    return path.read_bytes()


def assert_camera(camera, fx, fy, cx, cy, within=1e-9):
    np.testing.assert_allclose((camera.fx, camera.fy, camera.cx, camera.cy), (fx, fy, cx, cy), atol=within, rtol=0)


WIDTH, HEIGHT = 64, 48
MATRIX = [60.0, 0, 0, 0, 61.0, 0, 31.5, 23.5, 1]


def write_folder(folder, *, depth=None, color=True, intrinsic=None, mirrors=None):
    """A small capture; ``depth`` a list of images, ``intrinsic`` and ``mirrors`` objects or raw text."""
    (folder / "depth").mkdir(parents=True)
    frame = np.full((HEIGHT, WIDTH), 2000, np.uint16)
    for i, image in enumerate([frame, frame + 1] if depth is None else depth):
        write_png(folder / "depth" / f"{i:06d}.png", image)
    if color:
        (folder / "color").mkdir()
        write_png(folder / "color" / "000000.png", np.full((HEIGHT, WIDTH, 3), (10, 20, 30), np.uint8))
    if intrinsic is None:
        intrinsic = {"width": WIDTH, "height": HEIGHT, "intrinsic_matrix": MATRIX}
    for name, content in (("intrinsic.json", intrinsic), ("mirrors.json", mirrors)):
        if content is not None:
            (folder / name).write_text(content if isinstance(content, str) else json.dumps(content))
    return folder


def assert_one_line_naming(error: MirrorScanError, path) -> None:
    text = str(error)
    assert str(path) in text
    assert "\n" not in text
    assert len(text) < 400 + len(str(path))


PLY_TYPES = dict(zip("char uchar short ushort int uint float double".split(), "bBhHiIfd", strict=True))


def make_ply(layout: str, count_type: str, index_type: str, coordinate_type: str, polygons: list[list[int]]) -> bytes:
    """A PLY by Python's own struct: a ring of vertices, an element nobody knows, faces with values around the list."""
    ring = max(3, *map(len, polygons)) if polygons else 3
    order = ">" if layout == "binary_big_endian" else "<"
    header = f"""ply
format {layout} 1.0
comment made by hand
element camera 2
property float focal
property list uchar short codes
element vertex {ring}
property uchar flag
property {coordinate_type} x
property {coordinate_type} y
property {coordinate_type} z
element face {len(polygons)}
property float quality
property list {count_type} {index_type} vertex_index
property uchar kind
end_header
"""
    body = []

    def put(kind, *values):
        if layout == "ascii":
            body.append((" ".join(map(str, values)) + "\n").encode())
        else:
            body.append(struct.pack(order + PLY_TYPES[kind] * len(values), *values))

    for i in range(2):
        put("float", 1.5)
        put("uchar", i)
        put("short", *range(-i, 0))
    for i in range(ring):
        put("uchar", 7)
        put(coordinate_type, i, i * i, 0)
    for i, polygon in enumerate(polygons):
        put("float", 0.5)
        put(count_type, len(polygon))
        put(index_type, *polygon)
        put("uchar", i % 3)
    return header.encode() + b"".join(body)


GOOD = make_ply("binary_little_endian", "uchar", "int", "float", [[0, 1, 2], [0, 1, 2, 3]])
