//! Reads markup as strictly as XML does, as far as ours goes, and says what is wrong.

/// An element's name and attributes.
pub struct Element {
    pub name: String,
    pub attributes: Vec<(String, String)>,
}

/// All elements in their order; an error where tags are not balanced, attributes not
/// quoted, or characters not escaped.
pub fn elements(markup: &str) -> Result<Vec<Element>, String> {
    let mut rest = markup.strip_prefix("<!DOCTYPE html>").unwrap_or(markup);
    let (mut open, mut found): (Vec<String>, Vec<Element>) = (Vec::new(), Vec::new());
    while let Some((text, after)) = rest.split_once('<') {
        escaped(text)?;
        let (tag, after) = after.split_once('>').ok_or_else(|| format!("no end of <{after}"))?;
        rest = after;
        if let Some(name) = tag.strip_prefix('/') {
            let last = open.pop();
            if last.as_deref() != Some(name) {
                return Err(format!("</{name}> closes {last:?}"));
            }
            continue;
        }
        let (tag, empty) = tag.strip_suffix('/').map_or((tag, false), |tag| (tag, true));
        let element = element(tag)?;
        if !empty {
            open.push(element.name.clone());
        }
        found.push(element);
    }
    escaped(rest)?;
    if open.is_empty() { Ok(found) } else { Err(format!("never closed: {open:?}")) }
}

fn element(tag: &str) -> Result<Element, String> {
    let (name, mut rest) = tag.split_once(' ').unwrap_or((tag, ""));
    if !name.starts_with(|c: char| c.is_ascii_alphabetic())
        || !name.chars().all(|c| c.is_ascii_alphanumeric())
    {
        return Err(format!("no name: <{tag}>"));
    }
    let mut attributes: Vec<(String, String)> = Vec::new();
    while !rest.trim().is_empty() {
        let parted = rest.split_once("=\"").and_then(|(key, after)| {
            let (value, after) = after.split_once('"')?;
            Some((key.trim(), value, after))
        });
        let (key, value, after) = parted.ok_or_else(|| format!("attributes of <{tag}>"))?;
        let fine = key.chars().all(|c| c.is_ascii_alphanumeric() || c == '-');
        if !fine || attributes.iter().any(|(other, _)| other == key) {
            return Err(format!("attribute {key} of <{tag}>"));
        }
        escaped(value)?;
        attributes.push((key.to_string(), value.to_string()));
        rest = after;
    }
    Ok(Element { name: name.to_string(), attributes })
}

fn escaped(text: &str) -> Result<(), String> {
    if let Some(bad) = text.chars().find(|c| *c == '>' || (c.is_control() && !"\n\t".contains(*c))) {
        return Err(format!("{bad:?} in {text}"));
    }
    let known = ["amp;", "lt;", "gt;", "quot;", "#39;"];
    match text.split('&').skip(1).find(|after| !known.iter().any(|entity| after.starts_with(entity))) {
        Some(after) => Err(format!("&{after}")),
        None => Ok(()),
    }
}

/// Attributes in which only lengths stand.
const LENGTHS: &[&str] =
    &["d", "x", "y", "cx", "cy", "r", "dx", "width", "height", "viewBox", "stroke-width", "stroke-dasharray"];

/// What in the drawings of a page is no number.
pub fn odd_lengths(elements: &[Element]) -> Vec<String> {
    let drawn = ["svg", "g", "path", "rect", "circle", "text", "tspan"];
    let lengths = elements
        .iter()
        .filter(|element| drawn.contains(&element.name.as_str()))
        .flat_map(|element| &element.attributes)
        .filter(|(key, _)| LENGTHS.contains(&key.as_str()));
    let odd = lengths.filter(|(_, value)| {
        value.is_empty() || !value.chars().all(|c| c.is_ascii_digit() || "-. MLahz".contains(c))
    });
    odd.map(|(key, value)| format!("{key}=\"{value}\"")).collect()
}

#[test]
fn broken_markup_is_seen() {
    for broken in
        ["<a>", "<a></b>", "</a>", "<a b=c/>", "<a>&</a>", "<a>x > y</a>", "<a b=\"1\" b=\"2\"/>", "<1/>"]
    {
        assert!(elements(broken).is_err(), "{broken}");
    }
    let fine = elements("<a b=\"1 &lt;\" c-d=\"\">x &amp; y<p/></a>\n").unwrap();
    assert_eq!(fine.len(), 2);
    let odd =
        elements("<svg viewBox=\"0 0 inf 1\"><path d=\"MNaN 1\"/><path d=\"M1 2L-3 .5z\"/></svg>").unwrap();
    assert_eq!(odd_lengths(&odd).len(), 2);
}
