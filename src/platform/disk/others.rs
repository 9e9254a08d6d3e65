//! Files that others put there: in a watched folder, or named on the command line.
//!
//! Whoever may write to a watched folder may put links, pipes and devices there,
//! and may put them in the place of a file while we look. So nothing is believed
//! of a path: a file is opened without waiting for anybody, must be a plain file by
//! the word of its handle, and is read to a bound. Below a watched folder no link
//! is followed, in no part of the path.

use std::ffi::{OsStr, OsString};
use std::fs::{File, Metadata};
use std::io::{self, Read};
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::ffi::OsStrExt;
use std::path::{Component, Path};
use std::time::Duration;

use rustix::fs::{AtFlags, CWD, Dir, FileType, Mode, OFlags, ResolveFlags, Stat, openat, openat2, statat};
use rustix::io::Errno;

/// Whether symbolic links on the way to a file are followed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Links {
    /// As for paths that a person names.
    #[default]
    Followed,
    /// As for all below a watched folder.
    Refused,
}

/// What is said of a path that leads through a link.
const IS_A_LINK: &str = "it is a link, or lies behind one; links are not followed below a watched folder";
const NO_FILE: &str = "it is not a plain file";

/// Tries at a file that somebody has a lease on, as Samba takes them: each try asks
/// the holder to let go.
const TRIES: u32 = 25;
const PAUSE: Duration = Duration::from_millis(20);

/// Opens a plain file for reading, and tells what it is by its handle. Never waits
/// for the other end of a pipe; what is no plain file is not even opened.
pub fn open_file(path: &Path, links: Links) -> io::Result<(File, Metadata)> {
    // Opening a device can do things; looking at it does not.
    plain(&File::from(open(path, OFlags::PATH, links)?))?;
    let flags = OFlags::RDONLY | OFlags::NONBLOCK | OFlags::NOCTTY;
    for _ in 1..TRIES {
        match open(path, flags, links) {
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => std::thread::sleep(PAUSE),
            opened => return opened.map(File::from).and_then(|file| plain(&file).map(|meta| (file, meta))),
        }
    }
    Err(io::Error::new(io::ErrorKind::WouldBlock, "another program holds it"))
}

/// What lies at a path, without opening it.
pub fn look_at(path: &Path, links: Links) -> io::Result<Metadata> {
    File::from(open(path, OFlags::PATH, links)?).metadata()
}

/// Reads a plain file that must not be longer than `most` bytes.
pub fn read_file(path: &Path, links: Links, most: u64) -> io::Result<Vec<u8>> {
    let (file, meta) = open_file(path, links)?;
    let too_long = |bytes| {
        let text = format!("it is {bytes} bytes long; at most {most} are read");
        io::Error::new(io::ErrorKind::InvalidData, text)
    };
    if meta.len() > most {
        return Err(too_long(meta.len()));
    }
    let mut bytes = Vec::new();
    // It may grow, and some files are longer than they say.
    file.take(most.saturating_add(1)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most { Err(too_long(bytes.len() as u64)) } else { Ok(bytes) }
}

/// What a folder holds.
#[derive(Debug, Clone)]
pub struct FolderEntry {
    pub name: OsString,
    pub kind: FileType,
    /// Of the entry itself; a link is not followed.
    pub stat: Stat,
}

/// Lists a folder, looking at each entry by the folder's own handle. What vanishes
/// meanwhile is left out.
pub fn list_folder(path: &Path, links: Links) -> io::Result<Vec<FolderEntry>> {
    let folder = open(path, OFlags::RDONLY | OFlags::DIRECTORY | OFlags::NONBLOCK, links)?;
    let mut entries = Vec::new();
    for entry in Dir::read_from(&folder)? {
        let entry = entry?;
        let name = OsStr::from_bytes(entry.file_name().to_bytes());
        if name == "." || name == ".." {
            continue;
        }
        match statat(folder.as_fd(), name, AtFlags::SYMLINK_NOFOLLOW) {
            Ok(stat) => {
                let kind = FileType::from_raw_mode(stat.st_mode);
                entries.push(FolderEntry { name: name.to_os_string(), kind, stat });
            }
            Err(Errno::NOENT) => {}
            Err(errno) => return Err(errno.into()),
        }
    }
    Ok(entries)
}

fn plain(file: &File) -> io::Result<Metadata> {
    let meta = file.metadata()?;
    match meta.is_file() {
        true => Ok(meta),
        false if meta.is_symlink() => Err(io::Error::new(io::ErrorKind::InvalidInput, IS_A_LINK)),
        false => Err(io::Error::new(io::ErrorKind::InvalidInput, NO_FILE)),
    }
}

fn open(path: &Path, flags: OFlags, links: Links) -> io::Result<OwnedFd> {
    let flags = flags | OFlags::CLOEXEC;
    let opened = match links {
        Links::Followed => openat(CWD, path, flags, Mode::empty()),
        Links::Refused => match openat2(CWD, path, flags, Mode::empty(), ResolveFlags::NO_SYMLINKS) {
            // Kernels before 5.6, and filters of system calls that do not know it.
            Err(Errno::NOSYS | Errno::PERM) => open_step_by_step(path, flags),
            opened => opened,
        },
    };
    opened.map_err(|errno| match errno {
        Errno::LOOP if links == Links::Refused => io::Error::new(io::ErrorKind::InvalidInput, IS_A_LINK),
        errno => errno.into(),
    })
}

/// The same without `openat2`: each folder is opened by its name in the one above.
fn open_step_by_step(path: &Path, flags: OFlags) -> Result<OwnedFd, Errno> {
    let folders = OFlags::PATH | OFlags::DIRECTORY | OFlags::NOFOLLOW | OFlags::CLOEXEC;
    let start = if path.is_absolute() { "/" } else { "." };
    let mut folder = openat(CWD, start, folders, Mode::empty())?;
    let names: Vec<_> =
        path.components().filter(|part| !matches!(part, Component::RootDir | Component::CurDir)).collect();
    let Some((last, above)) = names.split_last() else { return openat(CWD, start, flags, Mode::empty()) };
    for name in above {
        // With O_DIRECTORY a link is "not a folder".
        folder = openat(&folder, name.as_os_str(), folders, Mode::empty()).map_err(|errno| match errno {
            Errno::NOTDIR if is_link(&folder, name.as_os_str()) => Errno::LOOP,
            errno => errno,
        })?;
    }
    let name = last.as_os_str();
    // O_PATH opens the link itself.
    if is_link(&folder, name) {
        return Err(Errno::LOOP);
    }
    openat(&folder, name, flags | OFlags::NOFOLLOW, Mode::empty())
}

fn is_link(folder: &OwnedFd, name: &OsStr) -> bool {
    statat(folder, name, AtFlags::SYMLINK_NOFOLLOW)
        .is_ok_and(|stat| FileType::from_raw_mode(stat.st_mode) == FileType::Symlink)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use std::os::unix::fs::symlink;
    use std::path::PathBuf;

    fn room() -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().canonicalize().expect("a path");
        (folder, path)
    }

    /// Both ways to open without links, as errors' texts.
    fn refused(path: &Path) -> [String; 2] {
        let text = |error: io::Error| error.to_string();
        let slow = open_step_by_step(path, OFlags::RDONLY | OFlags::NONBLOCK | OFlags::CLOEXEC);
        [
            open_file(path, Links::Refused).map(drop).map_err(text).expect_err("refused"),
            match slow {
                Ok(fd) => plain(&File::from(fd)).map(drop).map_err(text).expect_err("refused"),
                Err(Errno::LOOP) => IS_A_LINK.to_string(),
                Err(errno) => text(errno.into()),
            },
        ]
    }

    #[test]
    fn no_part_of_a_path_may_be_a_link() {
        let (_keep, at) = room();
        fs::create_dir_all(at.join("real/deep")).expect("made");
        fs::write(at.join("real/deep/file"), "content").expect("written");
        symlink("file", at.join("real/deep/link")).expect("linked");
        symlink(at.join("real"), at.join("away")).expect("linked");
        symlink("/proc/self/pagemap", at.join("endless")).expect("linked");
        symlink("endless", at.join("twice")).expect("linked");
        for path in ["real/deep/link", "away/deep/file", "away/deep/link", "endless", "twice"] {
            for text in refused(&at.join(path)) {
                assert_eq!(text, IS_A_LINK, "{path}");
            }
            assert!(look_at(&at.join(path), Links::Refused).is_err(), "{path}");
        }
        for folder in ["away", "away/deep"] {
            assert!(list_folder(&at.join(folder), Links::Refused).is_err(), "{folder}");
            assert!(list_folder(&at.join(folder), Links::Followed).is_ok(), "{folder}");
        }
        let read = |path: &str, links| read_file(&at.join(path), links, 100).map_err(|e| e.to_string());
        assert_eq!(read("real/deep/file", Links::Refused), Ok(b"content".to_vec()));
        assert_eq!(read("away/deep/link", Links::Followed), Ok(b"content".to_vec()));
        let slow = open_step_by_step(&at.join("real/deep/file"), OFlags::RDONLY).expect("opened");
        assert_eq!(io::read_to_string(File::from(slow)).expect("read"), "content");
    }

    #[test]
    fn only_plain_files_are_opened_and_pipes_wait_for_nobody() {
        let (_keep, at) = room();
        let pipe = at.join("pipe");
        rustix::fs::mknodat(CWD, &pipe, FileType::Fifo, Mode::from_raw_mode(0o600), 0).expect("made");
        let _socket = std::os::unix::net::UnixListener::bind(at.join("socket")).expect("bound");
        for path in [pipe, at.join("socket"), at.clone(), PathBuf::from("/dev/zero")] {
            for links in [Links::Followed, Links::Refused] {
                let error = open_file(&path, links).expect_err("no file").to_string();
                assert_eq!(error, NO_FILE, "{}", path.display());
            }
        }
    }

    #[test]
    fn files_are_read_to_a_bound_whatever_length_they_tell() {
        let (_keep, at) = room();
        fs::write(at.join("file"), [7u8; 100]).expect("written");
        assert_eq!(read_file(&at.join("file"), Links::Refused, 100).expect("read").len(), 100);
        assert!(read_file(&at.join("file"), Links::Refused, 99).is_err());
        // Files of the kernel say that they are empty.
        assert!(read_file(Path::new("/proc/self/maps"), Links::Followed, 10).is_err());
    }

    #[test]
    fn a_folder_is_listed_with_links_as_links() {
        let (_keep, at) = room();
        fs::write(at.join("file"), "12").expect("written");
        symlink("file", at.join("link")).expect("linked");
        let mut entries = list_folder(&at, Links::Refused).expect("listed");
        entries.sort_by(|a, b| a.name.cmp(&b.name));
        let kinds: Vec<_> = entries.iter().map(|entry| (entry.name.to_str(), entry.kind)).collect();
        assert_eq!(kinds, [(Some("file"), FileType::RegularFile), (Some("link"), FileType::Symlink)]);
        assert_eq!(entries[0].stat.st_size, 2);
    }
}
