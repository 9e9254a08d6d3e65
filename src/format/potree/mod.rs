//! Potree 2.0 octrees: metadata.json, hierarchy.bin, octree.bin.
