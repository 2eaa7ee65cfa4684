"""Triangle meshes as the references see them: reading, checksums, and the two clean-ups that libigl needs."""

import hashlib
import pathlib

import numpy as np

# A triangle is zero-area where 2 area <= this times the square of its longest edge: libigl is non-finite there.
ZERO_AREA = 1e-8


class Mesh:
    """positions: n x 3 float64, triangles: m x 3 int64, in file order."""

    def __init__(self, positions, triangles):
        self.positions = np.ascontiguousarray(positions, np.float64)
        self.triangles = np.ascontiguousarray(triangles, np.int64)


def checksum(mesh):
    """What lapbench calls a mesh's sha256: of its positions (f64, little endian), then its triangles (u32)."""
    positions, triangles = mesh.positions.astype("<f8"), mesh.triangles.astype("<u4")
    return hashlib.sha256(positions.tobytes() + triangles.tobytes()).hexdigest()


def read(path):
    """PLY (binary little-endian, triangles only, x y z as the first properties) or OBJ (v and triangular f lines)."""
    path = pathlib.Path(path)
    if path.suffix.lower() == ".ply":
        return _read_ply(path)
    if path.suffix.lower() == ".obj":
        return _read_obj(path)
    raise ValueError(f"{path}: only .ply and .obj are read here")


_TYPES = {"float": "<f4", "float32": "<f4", "double": "<f8", "float64": "<f8", "int": "<i4", "int32": "<i4",
          "uint": "<u4", "uint32": "<u4", "uchar": "u1", "uint8": "u1", "char": "i1", "int8": "i1",
          "short": "<i2", "int16": "<i2", "ushort": "<u2", "uint16": "<u2"}


def _read_ply(path):
    data = path.read_bytes()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    lines = [line.split() for line in data[:end].decode("latin1").splitlines()]
    if ["format", "binary_little_endian", "1.0"] not in lines:
        raise ValueError(f"{path}: only binary_little_endian PLY is read here")
    elements, properties = {}, {}
    for words in lines:
        if words[0] == "element":
            name = words[1]
            elements[name], properties[name] = int(words[2]), []
        elif words[0] == "property":
            properties[name].append(words[1:])
    vertex = np.dtype([(words[1], _TYPES[words[0]]) for words in properties["vertex"]])
    (_, count_type, index_type, _), = properties["face"]
    face = np.dtype([("count", _TYPES[count_type]), ("corners", _TYPES[index_type], 3)])
    vertices = np.frombuffer(data, vertex, elements["vertex"], end)
    faces = np.frombuffer(data, face, elements["face"], end + vertices.nbytes)
    if (faces["count"] != 3).any():
        raise ValueError(f"{path}: a face is not a triangle")
    return Mesh(np.stack([vertices[axis] for axis in "xyz"], axis=1), faces["corners"])


def _read_obj(path):
    positions, triangles = [], []
    for line in path.read_text().splitlines():
        words = line.split()
        if words[:1] == ["v"]:
            positions.append([float(word) for word in words[1:4]])
        elif words[:1] == ["f"]:
            triangles.append([int(word.split("/")[0]) - 1 for word in words[1:]])
    return Mesh(positions, triangles)


def corner_angles(mesh):
    """m x 3: the angle at each corner in radians, accurate for needles too (atan2 of cross and dot product)."""
    corners = mesh.positions[mesh.triangles]
    angles = np.empty(mesh.triangles.shape)
    for i in range(3):
        u, v = corners[:, (i + 1) % 3] - corners[:, i], corners[:, (i + 2) % 3] - corners[:, i]
        angles[:, i] = np.arctan2(np.linalg.norm(np.cross(u, v), axis=1), (u * v).sum(axis=1))
    return angles


def zero_area(mesh):
    """Which triangles are zero-area; a repeated corner makes one too."""
    corners = mesh.positions[mesh.triangles]
    edges = [corners[:, (i + 1) % 3] - corners[:, i] for i in range(3)]
    longest = np.max([(edge * edge).sum(axis=1) for edge in edges], axis=0)
    return np.linalg.norm(np.cross(edges[0], edges[1]), axis=1) <= ZERO_AREA * longest


def compacted(mesh):
    """The mesh without zero-area triangles and without vertices that no triangle uses, and the file's index of each
    remaining vertex."""
    triangles = mesh.triangles[~zero_area(mesh)]
    used, renumbered = np.unique(triangles, return_inverse=True)
    return Mesh(mesh.positions[used], renumbered.reshape(triangles.shape)), used
