//! `docs/needs.md` names a test for each pain; here it is seen that they exist, and
//! that no pain is forgotten.

use std::fs;
use std::path::Path;

fn sources(folder: &Path, text: &mut String) {
    for entry in fs::read_dir(folder).expect("a folder").flatten() {
        let path = entry.path();
        if path.is_dir() {
            sources(&path, text);
        } else if path.extension().is_some_and(|end| end == "rs") {
            text.push_str(&fs::read_to_string(&path).expect("readable"));
        }
    }
}

#[test]
fn every_test_that_is_named_for_a_pain_exists() {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut code = String::new();
    for folder in ["src", "tests"] {
        sources(&here.join(folder), &mut code);
    }
    let list = fs::read_to_string(here.join("docs/needs.md")).expect("the list");
    let rows: Vec<&str> =
        list.lines().filter(|line| line.starts_with("| ") && !line.starts_with("| pain")).collect();
    assert!(rows.len() > 30, "only {} pains", rows.len());
    for row in rows {
        let answer = row.split('|').nth(2).expect("two columns");
        let is_test = |word: &&str| word.matches('_').count() >= 2;
        let named: Vec<&str> = answer.split('`').skip(1).step_by(2).filter(is_test).collect();
        assert!(!named.is_empty(), "no test for: {row}");
        for name in named {
            assert!(code.contains(&format!("fn {name}(")), "there is no test {name}");
        }
    }
}

/// What is worth comparing of a text: words and numbers, without their endings.
fn words(text: &str) -> Vec<String> {
    text.to_lowercase()
        .split(|c: char| !c.is_ascii_alphanumeric())
        .filter(|word| word.len() >= 3 || word.parse::<u32>().is_ok())
        .map(|word| word.chars().take(5).collect())
        .collect()
}

/// The list of pains lies beside the real clouds. Its sections are lines; a pain has
/// its row where one of the section with its name shares half of its words.
#[test]
fn every_pain_of_the_list_has_its_row() {
    let list = std::env::var("LODESTONE_DATA").map(|data| Path::new(&data).join("../NEEDS.md"));
    let Some(list) = list.ok().and_then(|path| fs::read_to_string(path).ok()) else {
        eprintln!("no list of pains beside LODESTONE_DATA: not run");
        return;
    };
    let page = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/needs.md")).unwrap();
    let mut pains = 0;
    for section in ["Geometry", "Files", "Output", "Machine", "Watcher", "Queue"] {
        let front = format!("**{section}**: ");
        let line = list.lines().find_map(|line| line.strip_prefix(&front)).expect("a line");
        let rows = page.split(&format!("## {section}\n")).nth(1).expect("a section");
        let rows: Vec<String> =
            rows.split("\n## ").next().unwrap_or_default().lines().map(str::to_lowercase).collect();
        for pain in line.split(" · ").flat_map(|part| part.split("; ")) {
            let words = words(pain);
            let has = |row: &String| words.iter().filter(|word| row.contains(word.as_str())).count();
            let best = rows.iter().map(has).max().unwrap_or(0);
            assert!(best > 0 && 2 * best >= words.len(), "{section} has no row for: {pain}");
            pains += 1;
        }
    }
    assert!(pains > 50, "only {pains} pains");
}
