//! A contact sheet: a page of the pictures of many octrees, each with its name.

use std::path::Path;

use crate::convert::preview::PreviewManifest;

/// The page; `entries` are the folders of pictures beside it and what they hold.
pub fn page(entries: &[(String, PreviewManifest)]) -> String {
    let mut figures = String::new();
    for (folder, preview) in entries {
        let (name, link) = (escaped(folder), link(folder));
        let first = preview.assets.iter().find(|asset| asset.frames == 1);
        let moving = preview.assets.iter().find(|asset| asset.frames > 1);
        let Some(first) = first.or(moving) else { continue };
        let still = format!("{link}/{}", first.href);
        let moving = moving.map_or(still.clone(), |asset| format!("{link}/{}", asset.href));
        let points = first.effort.points;
        figures.push_str(&format!(
            "<figure><a href=\"{moving}\"><img src=\"{still}\" alt=\"{name}\" loading=\"lazy\"></a>\
             <figcaption><b>{name}</b><br>{} · {points} points drawn</figcaption></figure>\n",
            escaped(&preview.shows),
        ));
    }
    format!("{HEAD}{figures}</main>\n")
}

const HEAD: &str = "<!doctype html>\n<html lang=\"en\"><meta charset=\"utf-8\">\
<meta name=\"viewport\" content=\"width=device-width\"><title>Contact sheet</title>\n<style>\n\
body { margin: 0; background: #22272f; color: #d8dde4; font: 14px/1.4 system-ui, sans-serif }\n\
main { display: grid; grid-template-columns: repeat(auto-fill, minmax(300px, 1fr)); gap: 12px; padding: 12px }\n\
figure { margin: 0 } img { width: 100%; display: block; border-radius: 4px }\n\
figcaption { padding: 6px 2px; overflow-wrap: anywhere }\n</style>\n<main>\n";

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}

/// A name as part of an address.
fn link(name: &str) -> String {
    let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-._~".contains(&byte);
    name.bytes().map(|b| if plain(b) { char::from(b).to_string() } else { format!("%{b:02X}") }).collect()
}

/// The name under which an octree's pictures stand on the sheet.
pub fn name_of(octree: &Path) -> String {
    let real = std::fs::canonicalize(octree).unwrap_or_else(|_| octree.to_path_buf());
    real.file_name().map_or("octree".into(), |name| name.to_string_lossy().into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cannot_break_the_page() {
        let preview: PreviewManifest = serde_json::from_str(
            r#"{"shows": "rgb", "renderer": "cpu", "seconds": 1, "assets": [{"href": "thumbnail.png",
                "type": "image/png", "roles": ["thumbnail"], "width": 1, "height": 1, "frames": 1,
                "bytes": 1, "nodes": 1, "points": 7, "bytes_read": 1, "seconds": 1}]}"#,
        )
        .unwrap();
        let page = page(&[("a <b>\" & c".into(), preview)]);
        assert!(page.contains("src=\"a%20%3Cb%3E%22%20%26%20c/thumbnail.png\""), "{page}");
        assert!(page.contains("a &lt;b>&quot; &amp; c"), "{page}");
    }
}
