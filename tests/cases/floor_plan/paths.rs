//! Which paths a Rust source names: a tokenizer and just enough grammar to
//! expand `use` trees, follow `super` and know inline modules.

/// One path that a source names, from its root on: `crate::…` as
/// `["crate", …]`, a crate's as `["las", …]`.
#[derive(Debug, Clone, PartialEq)]
pub struct Named {
    pub path: Vec<String>,
    pub line: usize,
    /// Inside a module that exists only under test.
    pub test: bool,
    /// The name that a `use` gives it here, `*` for all names behind it; none where the
    /// path is used as it is.
    pub name: Option<String>,
    /// Brought in for others too: `pub use`.
    pub is_passed_on: bool,
}

#[derive(Debug, Clone, PartialEq)]
enum Token {
    Word(String),
    /// `::`
    Path,
    Sign(char),
}

/// All paths of a source that lies at `module` (`["convert", "survey"]` for
/// src/convert/survey.rs, `["convert"]` for src/convert/mod.rs).
pub fn named(source: &str, module: &[String]) -> Vec<Named> {
    let tokens = tokens(source);
    let mut found = Vec::new();
    let mut local = Vec::new();
    // Modules that are open: their name and the depth of braces they end at.
    let mut open: Vec<(String, usize)> = Vec::new();
    let (mut depth, mut at) = (0, 0);
    while at < tokens.len() {
        let (token, line) = &tokens[at];
        let here: Vec<String> = module.iter().cloned().chain(open.iter().map(|o| o.0.clone())).collect();
        let test = open.iter().any(|o| o.0.starts_with("test"));
        match token {
            Token::Sign('{') => depth += 1,
            Token::Sign('}') => {
                depth -= 1;
                if open.last().is_some_and(|o| o.1 == depth) {
                    open.pop();
                }
            }
            Token::Word(word) if word == "mod" && is(&tokens, at + 2, &Token::Sign('{')) => {
                if let Some((Token::Word(name), _)) = tokens.get(at + 1) {
                    open.push((name.clone(), depth));
                }
                at += 1;
            }
            // `pub(in path)` says who may see something, and imports nothing.
            Token::Word(word) if word == "in" && is(&tokens, at.wrapping_sub(1), &Token::Sign('(')) => {
                at += 1;
                straight(&tokens, &mut at);
                continue;
            }
            Token::Word(word) if word == "use" => {
                let is_passed_on = is_public(&tokens, at);
                at += 1;
                for (path, name) in tree(&tokens, &mut at) {
                    let path = absolute(path, &here);
                    local.push(name.clone());
                    found.push(Named { path, line: *line, test, name: Some(name), is_passed_on });
                }
            }
            Token::Word(_) if !is(&tokens, at.wrapping_sub(1), &Token::Path) => {
                let path = straight(&tokens, &mut at);
                // A name that a `use` brought in is no root.
                if path.len() > 1 && !local.contains(&path[0]) {
                    let path = absolute(path, &here);
                    found.push(Named { path, line: *line, test, name: None, is_passed_on: false });
                }
                continue;
            }
            _ => {}
        }
        at += 1;
    }
    found
}

fn is(tokens: &[(Token, usize)], at: usize, wanted: &Token) -> bool {
    tokens.get(at).is_some_and(|(token, _)| token == wanted)
}

/// Whether `pub`, or `pub(…)`, stands in front of the token at `at`.
fn is_public(tokens: &[(Token, usize)], at: usize) -> bool {
    let mut before = at.wrapping_sub(1);
    if is(tokens, before, &Token::Sign(')')) {
        let open = tokens[..before].iter().rposition(|(token, _)| *token == Token::Sign('('));
        before = open.unwrap_or(0).wrapping_sub(1);
    }
    is(tokens, before, &Token::Word("pub".to_string()))
}

/// A path without braces; `at` ends behind it.
fn straight(tokens: &[(Token, usize)], at: &mut usize) -> Vec<String> {
    let mut path = Vec::new();
    while let Some((Token::Word(word), _)) = tokens.get(*at) {
        path.push(word.clone());
        *at += 1;
        if !is(tokens, *at, &Token::Path) {
            break;
        }
        *at += 1;
    }
    path
}

/// The paths of a `use` tree with the names that they get; `at` ends at its last token.
fn tree(tokens: &[(Token, usize)], at: &mut usize) -> Vec<(Vec<String>, String)> {
    if is(tokens, *at, &Token::Path) {
        *at += 1;
    }
    let prefix = straight(tokens, at);
    let mut paths = Vec::new();
    match tokens.get(*at) {
        Some((Token::Sign('{'), _)) => {
            *at += 1;
            while *at < tokens.len() && !is(tokens, *at, &Token::Sign('}')) {
                if is(tokens, *at, &Token::Sign(',')) {
                    *at += 1;
                    continue;
                }
                for (rest, name) in tree(tokens, at) {
                    let own = || prefix.last().cloned().unwrap_or_default();
                    let name = if rest == ["self"] && name == "self" { own() } else { name };
                    paths.push((prefix.iter().cloned().chain(rest).collect(), name));
                }
            }
            *at += 1;
        }
        Some((Token::Sign('*'), _)) => {
            *at += 1;
            paths.push((prefix.into_iter().chain(["*".to_string()]).collect(), "*".to_string()));
        }
        Some((Token::Word(word), _)) if word == "as" => {
            let name = match tokens.get(*at + 1) {
                Some((Token::Word(name), _)) => name.clone(),
                _ => String::new(),
            };
            *at += 2;
            paths.push((prefix, name));
        }
        _ => {
            let name = prefix.last().cloned().unwrap_or_default();
            paths.push((prefix, name));
        }
    }
    paths
}

/// A path with `self` and `super` resolved.
fn absolute(path: Vec<String>, here: &[String]) -> Vec<String> {
    let supers = path.iter().take_while(|part| *part == "super" || *part == "self").count();
    if supers == 0 {
        return path;
    }
    let up = path[..supers].iter().filter(|part| *part == "super").count();
    let base = &here[..here.len().saturating_sub(up)];
    let root = std::iter::once("crate".to_string());
    root.chain(base.iter().cloned()).chain(path[supers..].iter().cloned()).collect()
}

/// The tokens of a source with their lines, without comments and literals.
fn tokens(source: &str) -> Vec<(Token, usize)> {
    let text: Vec<char> = source.chars().collect();
    let (mut found, mut at, mut line) = (Vec::new(), 0, 1);
    while at < text.len() {
        let end = match text[at] {
            '/' if text.get(at + 1) == Some(&'/') => until(&text, at, |t| t[0] == '\n'),
            '/' if text.get(at + 1) == Some(&'*') => until(&text, at + 2, |t| t.starts_with(&['*', '/'])) + 2,
            '"' => string(&text, at),
            '\'' => quote(&text, at),
            ':' if text.get(at + 1) == Some(&':') => {
                found.push((Token::Path, line));
                at + 2
            }
            c if c.is_alphabetic() || c == '_' => {
                let end = until(&text, at, |t| !t[0].is_alphanumeric() && t[0] != '_');
                let word: String = text[at..end].iter().collect();
                match (word.as_str(), text.get(end)) {
                    ("r" | "br", Some('"' | '#')) if raw(&text, end) != end => raw(&text, end),
                    ("b" | "c", Some('"')) => string(&text, end),
                    _ => {
                        found.push((Token::Word(word), line));
                        end
                    }
                }
            }
            c if c.is_ascii_digit() => until(&text, at, |t| !t[0].is_alphanumeric() && t[0] != '_'),
            c => {
                if !c.is_whitespace() {
                    found.push((Token::Sign(c), line));
                }
                at + 1
            }
        };
        let end = end.min(text.len());
        line += text[at..end].iter().filter(|&&c| c == '\n').count();
        at = end;
    }
    found
}

fn until(text: &[char], from: usize, stop: impl Fn(&[char]) -> bool) -> usize {
    (from..text.len()).find(|&i| stop(&text[i..])).unwrap_or(text.len())
}

/// Behind a string that begins at `at`.
fn string(text: &[char], at: usize) -> usize {
    let mut end = at + 1;
    while end < text.len() && text[end] != '"' {
        end += if text[end] == '\\' { 2 } else { 1 };
    }
    end + 1
}

/// Behind a raw string whose `#` or `"` stands at `at`; `at` if it is none.
fn raw(text: &[char], at: usize) -> usize {
    let quote = until(text, at, |t| t[0] != '#');
    if text.get(quote) != Some(&'"') {
        return at;
    }
    let close: Vec<char> = std::iter::once('"').chain(text[at..quote].iter().copied()).collect();
    until(text, quote + 1, |t| t.starts_with(&close)) + close.len()
}

/// Behind a character, or behind the tick of a lifetime.
fn quote(text: &[char], at: usize) -> usize {
    match (text.get(at + 1), text.get(at + 2)) {
        (Some('\\'), _) => until(text, at + 3, |t| t[0] == '\'') + 1,
        (Some(_), Some('\'')) => at + 3,
        _ => at + 1,
    }
}
