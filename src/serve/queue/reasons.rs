//! Why jobs failed, counted: of six hundred nobody reads one by one.
//!
//! Errors name their file, and say how many points of how many; with both left out,
//! equal reasons are equal.

use std::collections::HashMap;

use sqlx::Row;

use super::{Result, Shown, Store};
use crate::serve::job::JobId;

/// One reason, and how many jobs failed for it.
#[derive(Debug, Clone, PartialEq)]
pub struct FailureReason {
    /// As it is told of one of them, without its file.
    pub text: String,
    /// Names the reason in an order.
    pub key: String,
    pub jobs: i64,
    /// The latest of them, and its name.
    pub example: JobId,
    pub name: String,
}

/// Failed jobs whose reasons are counted for a page.
const COUNTED: i64 = 5000;

impl Store {
    /// Why jobs failed, the most frequent reasons first; of many jobs, the latest.
    pub async fn reasons(&self, shown: Shown, limit: usize) -> Result<Vec<FailureReason>> {
        let mut reasons: HashMap<String, FailureReason> = HashMap::new();
        for (id, name, error, source) in self.errors(shown, COUNTED).await? {
            let text = without_file(&error, &source);
            let new = || FailureReason { text: text.clone(), key: key(&text), jobs: 0, example: id, name };
            reasons.entry(alike(&text)).or_insert_with(new).jobs += 1;
        }
        let mut reasons: Vec<FailureReason> = reasons.into_values().collect();
        reasons.sort_by(|a, b| b.jobs.cmp(&a.jobs).then(b.example.cmp(&a.example)));
        reasons.truncate(limit);
        Ok(reasons)
    }

    /// The jobs that failed for this reason.
    pub async fn failed_for(&self, shown: Shown, reason: &str, limit: i64) -> Result<Vec<JobId>> {
        let errors = self.errors(shown, limit).await?;
        let is_it = |error: &str, source: &str| key(&without_file(error, source)) == reason;
        Ok(errors
            .into_iter()
            .filter(|(_, _, error, source)| is_it(error, source))
            .map(|(id, ..)| id)
            .collect())
    }

    /// Number, name, error and source of the latest jobs in this state.
    async fn errors(&self, shown: Shown, limit: i64) -> Result<Vec<(JobId, String, String, String)>> {
        let rows = sqlx::query(
            "SELECT id, name, coalesce(error, '') AS error, source FROM job WHERE id IN \
             (SELECT id FROM job INDEXED BY job_listed WHERE shown = ? ORDER BY id DESC LIMIT ?) ORDER BY id DESC",
        )
        .bind(shown.name())
        .bind(limit)
        .fetch_all(&self.readers)
        .await?;
        let error = |row: &sqlx::sqlite::SqliteRow| {
            Ok((row.try_get("id")?, row.try_get("name")?, row.try_get("error")?, row.try_get("source")?))
        };
        rows.iter().map(error).collect()
    }
}

/// An error without the path of what it is about, be it one of many files of a folder.
fn without_file(error: &str, source: &str) -> String {
    if source.is_empty() {
        return error.to_string();
    }
    let mut text = String::new();
    let mut rest = error;
    while let Some(at) = rest.find(source) {
        text.push_str(&rest[..at]);
        text.push('…');
        rest = &rest[at + source.len()..];
        // A file of the folder that was dropped; its name may hold anything.
        if rest.starts_with('/')
            && let Some(end) = end_of_cloud(rest)
        {
            rest = &rest[end..];
        }
    }
    text + rest
}

/// Where the name of a cloud ends in a text.
fn end_of_cloud(text: &str) -> Option<usize> {
    let lower = text.to_ascii_lowercase();
    [".las", ".laz"].iter().filter_map(|end| lower.find(end).map(|at| at + end.len())).min()
}

/// What equal reasons have in common: all but their numbers.
fn alike(text: &str) -> String {
    let mut alike = String::with_capacity(text.len());
    let mut in_number = false;
    for c in text.chars() {
        let joins = matches!(c, '.' | ',' | '\u{202f}' | '\u{a0}') && in_number;
        if c.is_ascii_digit() {
            if !in_number {
                alike.push('0');
            }
            in_number = true;
        } else if !joins {
            alike.push(c);
            in_number = false;
        }
    }
    alike
}

fn key(text: &str) -> String {
    blake3::hash(alike(text).as_bytes()).to_hex()[..16].to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reasons_are_equal_but_for_file_and_numbers() {
        let cut = |path: &str, points: &str| {
            let source = "/in/tiles 7";
            without_file(&format!("{source}{path} is cut: {points} could be read; look at {source}"), source)
        };
        let one = cut("/a.las.LAZ b/ü 1.las", "12 of 1300");
        let two = cut("/x.laz", "1\u{202f}299.5 of 7");
        // The name of a folder may end as a cloud's does; what is left of the path stays.
        assert!(one.contains("12 of 1300") && one.ends_with("look at …"), "{one}");
        assert_eq!(two, "… is cut: 1\u{202f}299.5 of 7 could be read; look at …");
        assert_eq!(key(&cut("/y.LAZ", "3 of 4")), key(&two));
        assert_eq!(key(&cut("", "3 of 4")), key(&two));
        assert_ne!(key(&cut("/y.laz", "none of 4")), key(&two));
        // Short names are not taken for parts of words.
        assert_eq!(without_file("a: cannot be read", "/a"), "a: cannot be read");
        assert_eq!(without_file("", ""), "");
    }
}
