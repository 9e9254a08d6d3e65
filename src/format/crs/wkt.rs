//! Reads well-known text of both versions (OGC 01-009, ISO 19162) into a tree of
//! keywords; what they mean is not decided here.

use std::fmt;

/// A keyword and what stands in its brackets.
#[derive(Debug, Clone, PartialEq)]
pub struct WktNode {
    /// In capitals.
    pub keyword: String,
    pub values: Vec<WktValue>,
}

#[derive(Debug, Clone, PartialEq)]
pub enum WktValue {
    Text(String),
    Number(f64),
    /// A bare word, such as EAST.
    Word(String),
    Node(WktNode),
}

/// The keywords of both versions for the kinds that matter here.
pub const PROJECTED: &[&str] = &["PROJCS", "PROJCRS", "PROJECTEDCRS"];
pub const GEODETIC: &[&str] =
    &["GEOGCS", "GEOGCRS", "GEOGRAPHICCRS", "GEODCRS", "GEODETICCRS", "BASEGEOGCRS", "BASEGEODCRS"];
pub const DATUM: &[&str] = &["DATUM", "GEODETICDATUM", "TRF", "ENSEMBLE"];
pub const ELLIPSOID: &[&str] = &["SPHEROID", "ELLIPSOID"];
pub const PRIME_MERIDIAN: &[&str] = &["PRIMEM", "PRIMEMERIDIAN"];
pub const METHOD: &[&str] = &["PROJECTION", "METHOD"];
pub const CODE: &[&str] = &["AUTHORITY", "ID"];

/// Brackets within brackets; real texts have eight.
const MOST_DEPTH: usize = 32;

impl WktNode {
    pub fn is(&self, keywords: &[&str]) -> bool {
        keywords.contains(&self.keyword.as_str())
    }

    pub fn children(&self) -> impl Iterator<Item = &WktNode> {
        self.values.iter().filter_map(|value| match value {
            WktValue::Node(node) => Some(node),
            _ => None,
        })
    }

    pub fn child(&self, keywords: &[&str]) -> Option<&WktNode> {
        self.children().find(|node| node.is(keywords))
    }

    /// The first text in the brackets.
    pub fn name(&self) -> &str {
        let text = self.values.iter().find_map(|value| match value {
            WktValue::Text(text) => Some(text.as_str()),
            _ => None,
        });
        text.unwrap_or_default()
    }

    pub fn numbers(&self) -> impl Iterator<Item = f64> {
        self.values.iter().filter_map(|value| match value {
            WktValue::Number(number) => Some(*number),
            _ => None,
        })
    }

    pub fn words(&self) -> impl Iterator<Item = &str> {
        self.values.iter().filter_map(|value| match value {
            WktValue::Word(word) => Some(word.as_str()),
            _ => None,
        })
    }

    /// Its own EPSG code.
    pub fn epsg(&self) -> Option<u16> {
        let code = self.child(CODE).filter(|code| code.name().eq_ignore_ascii_case("EPSG"))?;
        code.values.iter().skip(1).find_map(|value| match value {
            WktValue::Number(number) => Some(*number as u16),
            WktValue::Text(text) => text.trim().parse().ok(),
            _ => None,
        })
    }
}

impl fmt::Display for WktNode {
    /// As WKT, in one line.
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}[", self.keyword)?;
        for (number, value) in self.values.iter().enumerate() {
            f.write_str(if number == 0 { "" } else { "," })?;
            match value {
                WktValue::Text(text) => write!(f, "\"{}\"", text.replace('"', "\"\""))?,
                WktValue::Number(number) => write!(f, "{number}")?,
                WktValue::Word(word) => f.write_str(word)?,
                WktValue::Node(node) => node.fmt(f)?,
            }
        }
        f.write_str("]")
    }
}

/// A text that is one node, whatever follows it.
pub fn parse(text: &str) -> Option<WktNode> {
    let mut rest = text.trim_start_matches(['\u{feff}', ' ', '\t', '\r', '\n']);
    node(&mut rest, 0)
}

/// The WKT within another text, from a keyword that begins such to the bracket
/// that closes it.
pub fn within(text: &str) -> Option<&str> {
    const STARTS: [&str; 7] =
        ["COMPD_CS[", "COMPOUNDCRS[", "PROJCS[", "PROJCRS[", "GEOGCS[", "GEOGCRS[", "GEOCCS["];
    let from = STARTS.iter().filter_map(|start| text.find(start)).min()?;
    let mut rest = &text[from..];
    let whole = rest;
    node(&mut rest, 0)?;
    Some(&whole[..whole.len() - rest.len()])
}

fn skip_blanks(rest: &mut &str) {
    *rest = rest.trim_start();
}

fn node(rest: &mut &str, depth: usize) -> Option<WktNode> {
    if depth > MOST_DEPTH {
        return None;
    }
    let keyword = word(rest)?.to_ascii_uppercase();
    skip_blanks(rest);
    let close = match rest.chars().next()? {
        '[' => ']',
        '(' => ')',
        _ => return None,
    };
    *rest = &rest[1..];
    let mut values = Vec::new();
    loop {
        skip_blanks(rest);
        match rest.chars().next()? {
            c if c == close => {
                *rest = &rest[1..];
                return Some(WktNode { keyword, values });
            }
            ',' => *rest = &rest[1..],
            '"' => values.push(WktValue::Text(quoted(rest)?)),
            c if c.is_ascii_digit() || matches!(c, '-' | '+' | '.') => values.push(number(rest)?),
            _ => {
                let mut ahead = *rest;
                word(&mut ahead)?;
                skip_blanks(&mut ahead);
                values.push(match ahead.starts_with(['[', '(']) {
                    true => WktValue::Node(node(rest, depth + 1)?),
                    false => WktValue::Word(word(rest)?.to_string()),
                });
            }
        }
    }
}

fn word<'t>(rest: &mut &'t str) -> Option<&'t str> {
    let end = rest.find(|c: char| !c.is_ascii_alphanumeric() && c != '_').unwrap_or(rest.len());
    let (word, after) = rest.split_at(end);
    *rest = after;
    (!word.is_empty()).then_some(word)
}

/// A text in quotes; a doubled quote is one of the text.
fn quoted(rest: &mut &str) -> Option<String> {
    let mut text = String::new();
    let mut from = &rest[1..];
    loop {
        let end = from.find('"')?;
        text.push_str(&from[..end]);
        from = &from[end + 1..];
        if !from.starts_with('"') {
            *rest = from;
            return Some(text);
        }
        text.push('"');
        from = &from[1..];
    }
}

fn number(rest: &mut &str) -> Option<WktValue> {
    let is_part = |c: char| c.is_ascii_digit() || matches!(c, '-' | '+' | '.' | 'e' | 'E');
    let end = rest.find(|c| !is_part(c)).unwrap_or(rest.len());
    let (number, after) = rest.split_at(end);
    *rest = after;
    number.parse().ok().filter(|number: &f64| number.is_finite()).map(WktValue::Number)
}
