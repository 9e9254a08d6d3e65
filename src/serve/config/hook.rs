//! A hook: a program with its arguments, run without a shell, so that nothing in
//! a file's name is ever a command.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// The program and its arguments; never empty.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Hook(Vec<String>);

#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}; write a program's path, or a list as in [\"notify\", \"--quiet\"]")]
pub struct HookError(String);

impl Hook {
    pub fn new(words: Vec<String>) -> Result<Hook, HookError> {
        match words.first() {
            None => Err(HookError("an empty list names no program".to_string())),
            Some(program) if program.trim().is_empty() => {
                Err(HookError("the program has no name".to_string()))
            }
            _ if words.iter().any(|word| word.contains('\0')) => {
                Err(HookError("a zero byte cannot be handed to a program".to_string()))
            }
            Some(_) => Ok(Hook(words)),
        }
    }

    pub fn program(&self) -> &str {
        &self.0[0]
    }

    pub fn arguments(&self) -> &[String] {
        &self.0[1..]
    }
}

/// As a flag or in the environment: a JSON list, or the path of a program, which
/// is taken whole, spaces and all.
impl FromStr for Hook {
    type Err = HookError;

    fn from_str(text: &str) -> Result<Hook, HookError> {
        if !text.trim_start().starts_with('[') {
            return Hook::new(vec![text.to_string()]);
        }
        let words = serde_json::from_str(text).map_err(|e| HookError(format!("no list of words ({e})")))?;
        Hook::new(words)
    }
}

impl fmt::Display for Hook {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0.join(" "))
    }
}

impl Serialize for Hook {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.0.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Hook {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Hook, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged)]
        enum Either {
            Program(String),
            Words(Vec<String>),
        }
        let words = match Either::deserialize(deserializer)? {
            Either::Program(program) => vec![program],
            Either::Words(words) => words,
        };
        Hook::new(words).map_err(serde::de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_is_taken_whole_and_a_list_word_by_word() {
        let words = |text: &str| text.parse::<Hook>().map(|hook| hook.0);
        assert_eq!(words("/opt/my tools/tell"), Ok(vec!["/opt/my tools/tell".to_string()]));
        assert_eq!(words(r#"["tell", "-a b", "$X; rm"]"#).expect("a list"), ["tell", "-a b", "$X; rm"]);
        for wrong in ["", "  ", "[]", "[1]", "[\"a\"", r#"[""]"#] {
            assert!(wrong.parse::<Hook>().is_err(), "{wrong}");
        }
    }
}
