//! Which files a person means: files, folders with all LAS and LAZ below them,
//! and `@list` files that name one of either a line.

use std::collections::HashSet;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

#[derive(Debug, thiserror::Error)]
pub enum InputsError {
    #[error("could not read {}: {source}", path.display())]
    Read {
        path: PathBuf,
        #[source]
        source: io::Error,
    },
    #[error("there is no LAS or LAZ file in {}; name files, or a folder that holds some", .0.display())]
    EmptyFolder(PathBuf),
    #[error("folders are nested more than {DEEPEST_FOLDER} deep at {}; move what lies below it up", .0.display())]
    TooDeep(PathBuf),
    #[error("{} names no input", .0.display())]
    EmptyList(PathBuf),
    #[error("lists of files are nested more than {0} deep; does {1} name itself?")]
    Nested(usize, String),
}

const DEEPEST_LIST: usize = 8;

/// How deep tiles may lie below a folder that is named. Deeper ones are an error, not
/// left out.
pub const DEEPEST_FOLDER: usize = 200;

/// Whether a file's name ends as LAS and LAZ files' do, in any letter case.
pub fn is_las_name(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("las") || e.eq_ignore_ascii_case("laz"))
}

/// All files meant by the arguments, each once, those of a folder by name.
pub fn expand(arguments: &[PathBuf]) -> Result<Vec<PathBuf>, InputsError> {
    let mut files = Vec::new();
    for argument in arguments {
        expand_one(argument, 0, &mut files)?;
    }
    let mut seen = HashSet::new();
    files.retain(|file| seen.insert(fs::canonicalize(file).unwrap_or_else(|_| file.clone())));
    Ok(files)
}

fn expand_one(argument: &Path, depth: usize, files: &mut Vec<PathBuf>) -> Result<(), InputsError> {
    let text = argument.to_string_lossy();
    if let Some(list) = text.strip_prefix('@').filter(|_| !argument.exists()) {
        if depth >= DEEPEST_LIST {
            return Err(InputsError::Nested(DEEPEST_LIST, list.to_string()));
        }
        return expand_list(Path::new(list), depth, files);
    }
    let read = |source| InputsError::Read { path: argument.to_path_buf(), source };
    if !fs::metadata(argument).map_err(read)?.is_dir() {
        files.push(argument.to_path_buf());
        return Ok(());
    }
    let before = files.len();
    walk(argument, 0, files)?;
    if files.len() == before {
        return Err(InputsError::EmptyFolder(argument.to_path_buf()));
    }
    Ok(())
}

/// One input a line; empty lines and lines from `#` on are skipped; a relative
/// name is looked for beside the list, then in the current folder.
fn expand_list(list: &Path, depth: usize, files: &mut Vec<PathBuf>) -> Result<(), InputsError> {
    let text =
        fs::read_to_string(list).map_err(|source| InputsError::Read { path: list.to_path_buf(), source })?;
    let folder = list.parent().unwrap_or(Path::new(""));
    let before = files.len();
    for line in text.lines().map(str::trim).filter(|l| !l.is_empty() && !l.starts_with('#')) {
        match line.strip_prefix('@') {
            Some(nested) => {
                let nested = format!("@{}", beside(folder, nested).display());
                expand_one(Path::new(&nested), depth + 1, files)?;
            }
            None => expand_one(&beside(folder, line), depth + 1, files)?,
        }
    }
    if files.len() == before {
        return Err(InputsError::EmptyList(list.to_path_buf()));
    }
    Ok(())
}

fn beside(folder: &Path, name: &str) -> PathBuf {
    let there = folder.join(name);
    if there.exists() { there } else { PathBuf::from(name) }
}

/// LAS and LAZ files below a folder, sorted; links to folders are not followed,
/// so that no circle of them is walked for ever.
fn walk(folder: &Path, depth: usize, files: &mut Vec<PathBuf>) -> Result<(), InputsError> {
    if depth > DEEPEST_FOLDER {
        return Err(InputsError::TooDeep(folder.to_path_buf()));
    }
    let read = |source| InputsError::Read { path: folder.to_path_buf(), source };
    let mut entries: Vec<_> =
        fs::read_dir(folder).and_then(Iterator::collect::<io::Result<_>>).map_err(read)?;
    entries.sort_by_key(|e: &fs::DirEntry| e.file_name());
    for entry in entries {
        let kind = entry.file_type().map_err(read)?;
        if kind.is_dir() {
            walk(&entry.path(), depth + 1, files)?;
        } else if is_las_name(&entry.path()) && entry.path().is_file() {
            files.push(entry.path());
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_and_lists_name_files() {
        let root = tempfile::tempdir().unwrap();
        let at = |name: &str| root.path().join(name);
        fs::create_dir(at("tiles")).unwrap();
        for name in ["tiles/b.LAZ", "tiles/a.las", "tiles/readme.txt", "ünï cödé.las"] {
            fs::write(at(name), b"").unwrap();
        }
        fs::write(at("list.txt"), "# tiles\ntiles\n\nünï cödé.las\ntiles/a.las\n").unwrap();
        let list = PathBuf::from(format!("@{}", at("list.txt").display()));
        assert_eq!(expand(&[list]).unwrap(), [at("tiles/a.las"), at("tiles/b.LAZ"), at("ünï cödé.las")]);
        fs::write(at("loop.txt"), "@loop.txt").unwrap();
        let looped = PathBuf::from(format!("@{}", at("loop.txt").display()));
        assert!(matches!(expand(&[looped]), Err(InputsError::Nested(..))));
        fs::create_dir(at("empty")).unwrap();
        assert!(matches!(expand(&[at("empty")]), Err(InputsError::EmptyFolder(_))));
        assert!(matches!(expand(&[at("missing.las")]), Err(InputsError::Read { .. })));
    }

    #[test]
    fn deep_folders_are_read_or_an_error() {
        let root = tempfile::tempdir().unwrap();
        for (depth, found) in [(25, true), (DEEPEST_FOLDER, true), (DEEPEST_FOLDER + 1, false)] {
            let top = root.path().join(depth.to_string());
            let folder = (0..depth).fold(top.clone(), |folder, _| folder.join("f"));
            fs::create_dir_all(&folder).unwrap();
            fs::write(folder.join("a.las"), b"").unwrap();
            match expand(&[top]) {
                Ok(files) => assert!(found && files.len() == 1, "{depth}"),
                Err(error) => assert!(!found && matches!(error, InputsError::TooDeep(_)), "{error}"),
            }
        }
    }
}
