//! What a conversion writes: a Potree octree, a COPC file, or both from one pass.

use std::fmt;
use std::str::FromStr;

use serde::de::{self, Deserializer, SeqAccess, Visitor};
use serde::{Deserialize, Serialize, Serializer};

/// The formats that are written; at least one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Formats {
    /// metadata.json, hierarchy.bin and octree.bin.
    pub potree: bool,
    /// One `.copc.laz` file.
    pub copc: bool,
}

impl Formats {
    pub const POTREE: Formats = Formats { potree: true, copc: false };
    pub const COPC: Formats = Formats { potree: false, copc: true };
    pub const BOTH: Formats = Formats { potree: true, copc: true };

    /// Whether it is what is written if nobody asks: options are then hashed as
    /// before there was a choice.
    pub fn is_default(&self) -> bool {
        *self == Formats::default()
    }
}

impl Default for Formats {
    fn default() -> Formats {
        Formats::POTREE
    }
}

impl fmt::Display for Formats {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = [(self.potree, "potree"), (self.copc, "copc")];
        let names: Vec<&str> = names.into_iter().filter(|(is, _)| *is).map(|(_, name)| name).collect();
        f.write_str(&names.join(","))
    }
}

impl FromStr for Formats {
    type Err = String;

    /// Names with commas between them, in any letter case.
    fn from_str(text: &str) -> Result<Formats, String> {
        let mut formats = Formats { potree: false, copc: false };
        for name in text.split(',') {
            match name.trim().to_lowercase().as_str() {
                "potree" => formats.potree = true,
                "copc" => formats.copc = true,
                _ => return Err(format!("`{text}` is none of `potree`, `copc`, `potree,copc`")),
            }
        }
        Ok(formats)
    }
}

impl Serialize for Formats {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Formats {
    /// From names with commas between them, or a list of names.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Formats, D::Error> {
        struct Names;
        impl<'de> Visitor<'de> for Names {
            type Value = Formats;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("`potree`, `copc`, or both")
            }
            fn visit_str<E: de::Error>(self, text: &str) -> Result<Formats, E> {
                text.parse().map_err(E::custom)
            }
            fn visit_seq<A: SeqAccess<'de>>(self, mut names: A) -> Result<Formats, A::Error> {
                let mut all: Vec<String> = Vec::new();
                while let Some(name) = names.next_element()? {
                    all.push(name);
                }
                all.join(",").parse().map_err(de::Error::custom)
            }
        }
        deserializer.deserialize_any(Names)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_are_read_in_any_form() {
        let read = |json: &str| serde_json::from_str::<Formats>(json).map_err(|e| e.to_string());
        assert_eq!(read(r#""copc""#), Ok(Formats::COPC));
        assert_eq!(read(r#""COPC, Potree""#), Ok(Formats::BOTH));
        assert_eq!(read(r#"["potree", "copc"]"#), Ok(Formats::BOTH));
        assert_eq!(read(r#"["potree"]"#), Ok(Formats::POTREE));
        for wrong in [r#""""#, "[]", r#""ept""#, r#"["copc", "las"]"#, "7"] {
            assert!(read(wrong).is_err(), "{wrong}");
        }
        assert!(read(r#""ept""#).unwrap_err().contains("`ept` is none of `potree`"));
    }

    #[test]
    fn formats_are_written_in_one_form() {
        for (formats, text) in
            [(Formats::POTREE, "potree"), (Formats::COPC, "copc"), (Formats::BOTH, "potree,copc")]
        {
            assert_eq!(formats.to_string(), text);
            assert_eq!(text.parse(), Ok(formats));
            assert_eq!(serde_json::to_value(formats).unwrap(), text);
        }
    }
}
