//! Files in a watched folder that are not taken: what to tell of them.

/// The kinds of files that hold point clouds, and what turns them into LAS.
const CLOUDS: [(&[&str], &str); 12] = [
    (&["e57"], "E57 is not read; PDAL or CloudCompare turns it into LAS or LAZ"),
    (&["ply", "pcd"], "PLY and PCD are not read; PDAL or CloudCompare turns them into LAS or LAZ"),
    (&["ptx", "pts"], "PTX and PTS are not read; PDAL or CloudCompare turns them into LAS or LAZ"),
    (
        &["xyz", "xyzrgb", "asc", "neu"],
        "text is not read; PDAL (readers.text) or CloudCompare turns it into LAS or LAZ",
    ),
    (&["zlas"], "zLAS is not read; Esri's EzLAS turns it into LAS"),
    (&["rcp", "rcs"], "ReCap projects are not read; export them as LAS or E57"),
    (&["fls", "fws", "lsproj"], "FARO scans are not read; SCENE exports LAS or E57"),
    (&["rxp", "rdbx", "rdb"], "RIEGL files are not read; export them as LAS or LAZ"),
    (
        &["zfs", "zfc", "dp", "cl3", "clr", "imp", "tzf", "mjf", "pod"],
        "scanners' own files are not read; export them as LAS or LAZ",
    ),
    (&["bin", "fbi"], "a .bin or .fbi file is not read; CloudCompare or TerraScan saves it as LAS or LAZ"),
    (
        &["obj", "stl", "gltf", "glb", "drc", "fbx", "3ds", "off", "nxs", "nxz"],
        "meshes are not read; CloudCompare turns their points into LAS",
    ),
    (
        &["pnts", "3tz", "slpk", "i3s", "sqlite", "h5", "hdf5", "tdb"],
        "this kind is not read; PDAL turns many kinds of point clouds into LAS or LAZ",
    ),
];

/// Packed files.
const ARCHIVES: [&str; 13] =
    ["zip", "zipx", "rar", "7z", "tar", "tgz", "gz", "bz2", "xz", "zst", "lz4", "lzma", "cab"];

/// What lies beside tiles and is no cloud of its own.
const SIDECARS: [&str; 50] = [
    "txt", "pdf", "xml", "json", "geojson", "prj", "wkt", "wkt2", "lax", "md5", "sha1", "sha256", "sha512",
    "csv", "html", "htm", "jpg", "jpeg", "png", "tif", "tiff", "gif", "bmp", "tfw", "jgw", "ovr", "doc",
    "docx", "xls", "xlsx", "log", "ini", "cfg", "yml", "yaml", "toml", "md", "shp", "shx", "dbf", "cpg",
    "sbn", "sbx", "kml", "kmz", "gpkg", "dxf", "pos", "trj", "url",
];

fn ending(name: &str) -> String {
    name.rsplit_once('.').map(|(_, end)| end.to_lowercase()).unwrap_or_default()
}

/// What to do with a file that is not taken; `in_folder` where it lies with
/// tiles, among which lie many things that nobody expects to be converted.
pub(super) fn advice(name: &str, in_folder: bool) -> Option<String> {
    let end = ending(name);
    if let Some((_, what)) = CLOUDS.iter().find(|(ends, _)| ends.contains(&end.as_str())) {
        return Some(format!("is not taken: {what}"));
    }
    if ARCHIVES.contains(&end.as_str()) {
        return Some("is not taken: packed files are not read; unpack it here".to_string());
    }
    if in_folder && SIDECARS.contains(&end.as_str()) {
        return None;
    }
    let what =
        if end.is_empty() { "its name has no ending".to_string() } else { format!("`.{end}` is not read") };
    Some(format!("is not taken: {what}; LAS and LAZ are, and PDAL or CloudCompare turns much into them"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_taken_is_told_with_what_to_do() {
        for (name, word) in [
            ("scan.E57", "PDAL or CloudCompare"),
            ("a.ply", "PLY"),
            ("a.ptx", "PTX"),
            ("a.XYZ", "text"),
            ("a.laz.zip", "unpack"),
            ("a.7z", "unpack"),
            ("a.tar.gz", "unpack"),
            ("a.weird", "`.weird` is not read"),
            ("README", "no ending"),
        ] {
            for in_folder in [false, true] {
                let told = advice(name, in_folder).expect("told");
                assert!(told.contains(word), "{name}: {told}");
            }
        }
        for name in ["notes.txt", "a.prj", "a.lax", "a.laz.md5"] {
            assert!(advice(name, false).is_some() && advice(name, true).is_none(), "{name}");
        }
    }
}
