"""Reads COPC files with laspy (both of its backends) and copclib, and prints what each
found, a line a file: the number of points, and the hash of all records, sorted.

copclib goes through the hierarchy; every point must lie in its node's box.
"""

import hashlib
import json
import sys

import copclib
import laspy
import numpy


def digest(raw, length):
    records = numpy.frombuffer(raw, dtype=f"V{length}")
    ordered = sorted(record.tobytes() for record in records)
    return {"points": len(records), "sha256": hashlib.sha256(b"".join(ordered)).hexdigest()}


def by_laspy(path, backend):
    las = laspy.read(path, laz_backend=backend)
    return digest(las.points.array.tobytes(), las.header.point_format.size)


def by_copclib(path):
    reader = copclib.FileReader(path)
    header = reader.copc_config.las_header
    cube = reader.copc_config.copc_info
    center = numpy.array([cube.center_x, cube.center_y, cube.center_z])
    low = center - cube.halfsize
    scale = numpy.array([header.scale.x, header.scale.y, header.scale.z])
    offset = numpy.array([header.offset.x, header.offset.y, header.offset.z])
    length = header.point_record_length
    raw, nodes = [], 0
    for node in reader.GetAllNodes():
        bytes_of_node = bytes(reader.GetPointData(node))
        records = numpy.frombuffer(bytes_of_node, dtype=numpy.uint8).reshape(-1, length)
        stored = records[:, :12].copy().view("<i4").reshape(-1, 3)
        world = stored * scale + offset
        side = 2 * cube.halfsize / 2.0**node.key.d
        corner = low + side * numpy.array([node.key.x, node.key.y, node.key.z])
        inside = (corner <= world).all() and (world <= corner + side).all()
        assert len(world) == node.point_count, f"{node.key}: {len(world)} points, not {node.point_count}"
        assert inside, f"{node.key}: a point lies outside of its node's box"
        raw.append(bytes_of_node)
        nodes += 1
    return {**digest(b"".join(raw), length), "nodes": nodes}


for path in sys.argv[1:]:
    try:
        found = {
            "lazrs": by_laspy(path, laspy.LazBackend.Lazrs),
            "laszip": by_laspy(path, laspy.LazBackend.Laszip),
            "copclib": by_copclib(path),
        }
    except Exception as error:
        raise RuntimeError(path) from error
    print(json.dumps(found))
