//! `docs/needs.md` names a test for each pain; here it is seen that they exist.

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
