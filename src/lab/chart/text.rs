//! Text for markup: escaped, and as wide as it is likely to be.

/// Everything that stands in our markup and was not written here goes through this.
pub(super) fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            '\n' | '\t' => out.push(c),
            // XML knows no other control characters, and two characters that are none.
            c if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
    out
}

/// How wide a line of text is, in pixels. As wide as in DejaVu Sans, which is wider
/// than what most systems show, so what keeps apart by this does so everywhere.
pub(super) fn width(text: &str, size: f64) -> f64 {
    let em: f64 = text.chars().map(em).sum();
    em * size
}

fn em(c: char) -> f64 {
    match c {
        'i' | 'j' | 'l' | '\'' | '|' => 0.35,
        ' ' | '.' | ',' | ':' | ';' | '\u{202f}' | '·' | 'I' => 0.35,
        'f' | 't' | 'r' | '(' | ')' | '[' | ']' | '-' | '/' | '!' => 0.44,
        '⁰'..='⁹' | '⁻' | '¹' | '²' | '³' | '°' | '"' | '*' => 0.52,
        'm' | 'M' | 'w' | 'W' | '%' | '@' | '—' | '…' => 1.03,
        'a'..='z' | '0'..='9' | '?' | '_' | '–' => 0.645,
        'A'..='Z' | '&' | '#' => 0.8,
        '\u{300}'..='\u{36f}' => 0.0,
        '\u{0}'..='\u{24ff}' => 0.86,
        _ => 1.2,
    }
}

/// Cut with an ellipsis where it is wider than that.
pub(super) fn fitted(text: &str, size: f64, most: f64) -> String {
    if width(text, size) <= most {
        return text.to_string();
    }
    let mut left = most - width("…", size);
    let fits = |c: &char| {
        left -= em(*c) * size;
        left >= 0.0
    };
    let kept: String = text.chars().take_while(fits).collect();
    format!("{}…", kept.trim_end())
}

/// Broken between words into lines no wider than that; a longer word is cut.
pub(super) fn wrapped(text: &str, size: f64, most: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if width(line, size) + width(" ", size) + width(word, size) <= most => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(fitted(word, size, most)),
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_markup_means_is_escaped() {
        assert_eq!(escaped("<a b='c'>&\"\u{0}\n"), "&lt;a b=&#39;c&#39;&gt;&amp;&quot;\u{fffd}\n");
    }

    #[test]
    fn what_is_too_wide_is_cut_or_broken() {
        let text = "a sampler with a long name";
        assert_eq!(fitted(text, 12.0, 1e3), text);
        for most in [10.0, 40.0, 80.0] {
            let cut = fitted(text, 12.0, most);
            assert!(cut.ends_with('…') && width(&cut, 12.0) <= most.max(width("…", 12.0)), "{cut}");
            assert!(wrapped(text, 12.0, most).iter().all(|line| width(line, 12.0) <= most.max(13.0)));
        }
        assert_eq!(wrapped(text, 12.0, 140.0).join(" "), text);
    }
}
