//! Who may talk to the daemon, and under which names: tokens, allowed hosts and
//! the public address behind a proxy.

use std::net::IpAddr;
use std::path::{Path, PathBuf};

use super::error::{ConfigError, wrong};
use super::layer::Layer;

/// Shorter secrets are guessed.
const SHORTEST: usize = 8;
/// A token file is one line.
const LONGEST_FILE: u64 = 4096;

/// The checked settings of access. Without a token everybody who reaches the
/// address may read and operate.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Access {
    /// Lets its bearer read and operate.
    pub token: Option<String>,
    /// Where that token came from, if not from a setting itself.
    pub token_file: Option<PathBuf>,
    /// Lets its bearer read, and nothing else.
    pub read_token: Option<String>,
    pub read_token_file: Option<PathBuf>,
    /// Names, in small letters, with a port or for any port, under which the daemon
    /// may be asked.
    pub allowed_hosts: Vec<String>,
    pub public_url: Option<PublicUrl>,
}

/// Where browsers find the daemon, behind a proxy.
#[derive(Debug, Clone, PartialEq)]
pub struct PublicUrl {
    pub is_https: bool,
    /// Host, and port where it is not the scheme's, in small letters.
    pub authority: String,
    /// The path in front of every path of ours: empty, or `/sub/path` without a
    /// slash at its end.
    pub base: String,
}

impl Access {
    /// Checks the keys of a layer and reads the token files.
    pub(super) fn from_layer(layer: &Layer) -> Result<Access, ConfigError> {
        let token = secret("token", layer.token.as_deref(), "token_file", layer.token_file.as_deref())?;
        let read_token = secret(
            "read_token",
            layer.read_token.as_deref(),
            "read_token_file",
            layer.read_token_file.as_deref(),
        )?;
        if read_token.is_some() && token.is_none() {
            let message = "without a `token`, everybody may read and operate anyway; give one";
            return Err(wrong("read_token", message));
        }
        if read_token.is_some() && read_token == token {
            return Err(wrong("read_token", "equals the `token`, and so would allow what that allows"));
        }
        let mut allowed_hosts = Vec::new();
        for host in layer.allowed_hosts.iter().flat_map(|hosts| hosts.split(',')) {
            let host = host.trim().to_ascii_lowercase();
            if host.is_empty() {
                continue;
            }
            if host.contains(['/', '*', '@', ' ']) {
                let message = format!("`{host}` is no host name, as in scans.example.com or 10.0.0.7:8080");
                return Err(wrong("allowed_hosts", message));
            }
            allowed_hosts.push(host);
        }
        Ok(Access {
            token,
            token_file: layer.token_file.clone(),
            read_token,
            read_token_file: layer.read_token_file.clone(),
            allowed_hosts,
            public_url: layer.public_url.as_deref().map(PublicUrl::parse).transpose()?,
        })
    }

    /// The path in front of every path of ours; empty without a `public_url`.
    pub fn base(&self) -> &str {
        self.public_url.as_ref().map_or("", |url| &url.base)
    }

    /// Whether an authority (`host` or `host:port`, as the headers Host and Origin
    /// have it) is one of those that the settings name.
    pub fn names(&self, authority: &str) -> bool {
        let authority = authority.to_ascii_lowercase();
        let named = |known: &str| known == authority || known == host_of(&authority);
        self.allowed_hosts.iter().any(|host| named(host))
            || self.public_url.as_ref().is_some_and(|url| url.authority == authority)
    }
}

impl PublicUrl {
    fn parse(text: &str) -> Result<PublicUrl, ConfigError> {
        let bad = || {
            let message = format!("`{text}` is no address, as in https://scans.example.com/lodestone");
            wrong("public_url", message)
        };
        let (scheme, rest) = text.trim().split_once("://").ok_or_else(bad)?;
        let is_https = match scheme.to_ascii_lowercase().as_str() {
            "https" => true,
            "http" => false,
            _ => return Err(bad()),
        };
        let (authority, path) = rest.split_at(rest.find('/').unwrap_or(rest.len()));
        let is_plain = |c: char| c.is_ascii_alphanumeric() || "-._~".contains(c);
        if host_of(authority).is_empty() || !authority.chars().all(|c| is_plain(c) || "[]:".contains(c)) {
            return Err(bad());
        }
        let base = path.trim_end_matches('/');
        if base.contains("//") || !base.chars().all(|c| is_plain(c) || c == '/') || has_dot_segment(base) {
            return Err(bad());
        }
        let usual = if is_https { ":443" } else { ":80" };
        let authority = authority.to_ascii_lowercase();
        let authority = authority.strip_suffix(usual).unwrap_or(&authority).to_string();
        Ok(PublicUrl { is_https, authority, base: base.to_string() })
    }

    /// The address as it is written, without a slash at its end.
    pub fn text(&self) -> String {
        format!("{}://{}{}", if self.is_https { "https" } else { "http" }, self.authority, self.base)
    }
}

fn has_dot_segment(path: &str) -> bool {
    path.split('/').any(|part| part == "." || part == "..")
}

/// The name or address of an authority, without its port and brackets.
pub fn host_of(authority: &str) -> &str {
    match authority.strip_prefix('[') {
        Some(v6) => v6.split(']').next().unwrap_or(""),
        None => authority.split(':').next().unwrap_or(""),
    }
}

/// Whether an address is of this machine alone; `::ffff:127.0.0.1` is.
pub fn is_loopback(address: IpAddr) -> bool {
    address.to_canonical().is_loopback()
}

fn secret(
    key: &'static str,
    value: Option<&str>,
    file_key: &'static str,
    file: Option<&Path>,
) -> Result<Option<String>, ConfigError> {
    let (key, token) = match (value, file) {
        (None, None) => return Ok(None),
        (Some(_), Some(_)) => return Err(wrong(file_key, format!("`{key}` is given too; keep one of them"))),
        (Some(value), None) => (key, value.trim().to_string()),
        (None, Some(path)) => (file_key, read(file_key, path)?),
    };
    if token.len() < SHORTEST {
        return Err(wrong(key, format!("a secret of fewer than {SHORTEST} characters is none")));
    }
    if token.chars().any(char::is_control) {
        // It could not stand in a header.
        return Err(wrong(key, "a token is one line of text"));
    }
    Ok(Some(token))
}

/// A token from its file; white space around it does not count.
fn read(key: &'static str, path: &Path) -> Result<String, ConfigError> {
    use std::io::Read;
    let bad = |what: String| wrong(key, format!("{}: {what}", path.display()));
    let file = std::fs::File::open(path).map_err(|error| bad(error.to_string()))?;
    let mut text = String::new();
    file.take(LONGEST_FILE + 1).read_to_string(&mut text).map_err(|error| bad(error.to_string()))?;
    if text.len() as u64 > LONGEST_FILE {
        return Err(bad("is too long for a file with one token".to_string()));
    }
    Ok(text.trim().to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn access(toml: &str) -> Result<Access, String> {
        let layer: Layer = toml::from_str(toml).expect("a layer");
        Access::from_layer(&layer).map_err(|error| error.to_string())
    }

    #[test]
    fn tokens_come_from_settings_or_files() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("token");
        std::fs::write(&path, "  secret-of-a-file\n").expect("written");
        let found = access(&format!("token_file = '{}'", path.display())).expect("a token");
        assert_eq!(found.token.as_deref(), Some("secret-of-a-file"));
        let found = access("token = ' long enough '").expect("a token");
        assert_eq!(found.token.as_deref(), Some("long enough"));
        std::fs::write(&path, "short\n").expect("written");
        for (toml, word) in [
            (format!("token_file = '{}'", path.display()), "token_file"),
            (format!("token_file = '{}/none'", folder.path().display()), "/none"),
            (format!("token = 'long-enough'\ntoken_file = '{}'", path.display()), "keep one"),
            ("token = \"two\\nlines of text\"".to_string(), "one line"),
            ("read_token = 'long-enough'".to_string(), "token"),
            ("token = 'long-enough'\nread_token = 'long-enough'".to_string(), "equals"),
            ("allowed_hosts = ['http://a.example']".to_string(), "allowed_hosts"),
            ("allowed_hosts = ['*']".to_string(), "allowed_hosts"),
        ] {
            let error = access(&toml).expect_err(&toml);
            assert!(error.contains(word), "{toml}: {error}");
        }
        std::fs::write(&path, "x".repeat(5000)).expect("written");
        assert!(
            access(&format!("token_file = '{}'", path.display())).expect_err("long").contains("too long")
        );
    }

    #[test]
    fn public_addresses_are_taken_apart() {
        for (text, https, authority, base) in [
            ("https://scans.example.com", true, "scans.example.com", ""),
            ("https://Scans.Example.com:443/", true, "scans.example.com", ""),
            ("http://a.example:8080/x/y/", false, "a.example:8080", "/x/y"),
            ("HTTP://[::1]:80/x", false, "[::1]", "/x"),
        ] {
            let url = PublicUrl::parse(text).expect(text);
            assert_eq!((url.is_https, url.authority.as_str(), url.base.as_str()), (https, authority, base));
            assert_eq!(PublicUrl::parse(&url.text()).expect("again"), url);
        }
        for wrong in [
            "scans.example.com",
            "ftp://a.example",
            "https://",
            "https:///x",
            "https://u:p@a.example",
            "https://a.example/x?y",
            "https://a.example/a/../b",
            "https://a.example//b",
            "https://a.example/ü",
        ] {
            assert!(PublicUrl::parse(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn hosts_are_named_with_or_without_their_port() {
        let toml =
            "allowed_hosts = ['Scans.example.com, b.example:8080']\npublic_url = 'https://p.example/x'";
        let access = access(toml).expect("access");
        for (authority, named) in [
            ("scans.example.com", true),
            ("SCANS.example.com:7700", true),
            ("b.example:8080", true),
            ("b.example", false),
            ("b.example:80", false),
            ("p.example", true),
            ("p.example:8443", false),
            ("evil.scans.example.com", false),
            ("", false),
        ] {
            assert_eq!(access.names(authority), named, "{authority}");
        }
        assert_eq!(access.base(), "/x");
    }

    #[test]
    fn mapped_loopback_is_loopback() {
        for (address, is) in [
            ("127.0.0.9", true),
            ("::1", true),
            ("::ffff:127.0.0.1", true),
            ("::ffff:10.0.0.1", false),
            ("::", false),
        ] {
            assert_eq!(is_loopback(address.parse().expect(address)), is, "{address}");
        }
    }
}
