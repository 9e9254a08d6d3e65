//! `lodestone.json` in a folder: says that the folder is complete, and may give
//! the octree's name, conversion options, a priority, and what becomes of the
//! folder once it is converted.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::names;
use crate::convert::options::Options;
use crate::platform::disk::others::{self, Links};
use crate::serve::config::sources::OnDone;

/// The marker's file name.
pub const NAME: &str = "lodestone.json";

/// No marker is longer; the file comes from anybody who may write to the inbox.
const LONGEST: u64 = 64 << 10;

/// Whether a file is meant for a marker and misses its name: other letters, another
/// ending, or one more, which some systems hide.
pub fn is_misnamed(name: &str) -> bool {
    let lower = name.trim().to_lowercase();
    let meant = lower.starts_with(NAME)
        || matches!(lower.split_once('.'), Some(("lodestone", end)) if ENDINGS.contains(&end));
    meant && name != NAME && !names::is_partial(name)
}

/// What `.json` becomes by mistake.
const ENDINGS: [&str; 8] = ["jsn", "jso", "jsno", "jason", "json5", "jsonc", "yaml", "toml"];

/// What is wrong with a misnamed marker.
pub fn misnamed(name: &str) -> String {
    format!("{name} is no {NAME}, but close to it: name it exactly so, in small letters")
}

#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Marker {
    pub name: Option<String>,
    /// Only those that differ from the daemon's own.
    pub options: serde_json::Map<String, serde_json::Value>,
    pub priority: i64,
    /// What becomes of the folder afterwards, where not as configured.
    pub on_done: Option<OnDone>,
}

impl Marker {
    /// Reads a marker; the message says what is wrong with it.
    pub fn read(path: &Path) -> Result<Marker, String> {
        let text = others::read_file(path, Links::Refused, LONGEST)
            .map_err(|e| format!("{NAME} cannot be read: {e}"))?;
        // As editors on Windows begin a text.
        let text = text.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(&text);
        // A list of nothing would be read as a marker that says nothing.
        if text.iter().find(|byte| !byte.is_ascii_whitespace()).is_some_and(|byte| *byte != b'{') {
            return Err(format!("{NAME} is wrong: it must be an object, such as {{}}"));
        }
        let marker: Marker = serde_json::from_slice(text).map_err(|e| format!("{NAME} is wrong: {e}"))?;
        marker.options_over(&Options::default())?;
        Ok(marker)
    }

    /// The daemon's options with the marker's own over them.
    pub fn options_over(&self, base: &Options) -> Result<Options, String> {
        let wrong = |e: serde_json::Error| format!("{NAME}: wrong options: {e}");
        let mut value = serde_json::to_value(base).map_err(wrong)?;
        for (key, wish) in &self.options {
            match value.get_mut(key) {
                Some(slot) => *slot = wish.clone(),
                None if Options::WRITTEN_IF_GIVEN.contains(&key.as_str()) => value[key] = wish.clone(),
                None => return Err(format!("{NAME}: there is no option `{key}`")),
            }
        }
        serde_json::from_value(value).map_err(wrong)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::convert::options::{LodColor, Sampling};

    fn read(text: &str) -> Result<Marker, String> {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join(NAME);
        std::fs::write(&path, text).expect("written");
        Marker::read(&path)
    }

    #[test]
    fn an_empty_object_is_enough() {
        assert_eq!(read("{}"), Ok(Marker::default()));
    }

    #[test]
    fn names_close_to_its_own_are_mistakes() {
        for name in
            ["Lodestone.json", "LODESTONE.JSON", "lodestone.json.txt", "lodestone.jsn", "lodestone.json "]
        {
            assert!(is_misnamed(name), "{name}");
        }
        for name in [NAME, "lodestone.las", "lodestone.txt", "lodestone.json.part", "tiles.json", "lodestone"]
        {
            assert!(!is_misnamed(name), "{name}");
        }
    }

    #[test]
    fn a_mark_of_the_byte_order_is_skipped() {
        assert_eq!(read("\u{feff}{\"priority\": 2}").map(|marker| marker.priority), Ok(2));
    }

    #[test]
    fn options_lie_over_those_of_the_daemon() {
        let marker = read(
            r#"{"name": "city", "priority": 5, "options": {"sampling": "random", "lod_color": "average"}}"#,
        )
        .expect("fine");
        let base = Options { attributes: vec!["intensity".into()], ..Options::default() };
        let options = marker.options_over(&base).expect("fine");
        assert_eq!((options.sampling, options.lod_color), (Sampling::Random, LodColor::Average));
        assert_eq!(options.attributes, base.attributes);
    }

    #[test]
    fn mistakes_are_named() {
        for (text, word) in [
            ("", "wrong"),
            ("[]", "object"),
            (" [\"city\"]", "object"),
            ("null", "object"),
            ("7", "object"),
            (r#"{"nmae": "x"}"#, "nmae"),
            (r#"{"on_done": "burn"}"#, "burn"),
            (r#"{"options": {"samplng": "random"}}"#, "samplng"),
            (r#"{"options": {"sampling": "best"}}"#, "best"),
        ] {
            let message = read(text).expect_err("wrong");
            assert!(message.contains(word), "{message}");
        }
    }
}
