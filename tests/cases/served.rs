//! The daemon as shipped: unit, container, alerts, proxies, viewers on other pages.

mod access;
mod booted;
mod caching;
mod connections;
pub mod elsewhere;
mod reload;
mod shipped;

/// A header of an answer's head; empty where it is not there.
fn header(head: &str, name: &str) -> String {
    let found = head.lines().find_map(|line| {
        let (key, value) = line.split_once(':')?;
        key.eq_ignore_ascii_case(name).then(|| value.trim().to_string())
    });
    found.unwrap_or_default()
}
