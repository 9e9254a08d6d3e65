//! What can be read of a cut or damaged file. LAS has no checksums, and LAZ has
//! none either: damage shows where bytes end before their points do, or are left
//! over, or make no sense. A LAZ chunk in which it shows loses all its points,
//! since those before the place may be wrong already; where the file just ends,
//! those before its end are right.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use rayon::prelude::*;

use super::chunks::PointChunk;
use super::coding::Coding;
use super::points::PointBody;
use super::sequential::SequentialDecoder;
use super::stream::SKIP;
use super::{LasError, LasFile, ReadMode};
use crate::platform::disk::others::Links;

/// Lost chunks that are named one by one.
const MOST_NAMED: usize = 10;

/// What checking a file came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Checked {
    /// What is left can be read to the last point.
    Whole,
    /// It was told to stop.
    Stopped,
}

/// A chunk that cannot be decoded, and why.
struct Lost {
    chunk: PointChunk,
    reason: String,
}

impl LasFile {
    /// Opens what there is of a file, cut or not. How many points that is is
    /// only known once [`LasFile::leave_out_damaged`] has been through them.
    pub fn open_readable(path: &Path) -> Result<LasFile, LasError> {
        LasFile::open_readable_with(path, Links::Followed)
    }

    /// The same; links may be refused, as below a watched folder.
    pub fn open_readable_with(path: &Path, links: Links) -> Result<LasFile, LasError> {
        LasFile::open_as(path, ReadMode::Readable, links)
    }

    /// Decodes a LAZ file to the end, leaves out what cannot be, and notes it.
    /// `go_on` is told of points as they are looked at, and stops it all by
    /// `false`. Works on the threads of the current rayon pool.
    pub fn leave_out_damaged(&mut self, go_on: impl Fn(u64) -> bool + Sync) -> Result<Checked, LasError> {
        match &self.body {
            PointBody::Plain { .. } => Ok(Checked::Whole),
            PointBody::Chunks { coding, chunks } => match self.lost(coding, chunks, &go_on)? {
                Some(mut lost) => {
                    self.keep_recounted(&mut lost);
                    self.drop_chunks(&lost);
                    Ok(Checked::Whole)
                }
                None => Ok(Checked::Stopped),
            },
            PointBody::Stream(turnstile) => match self.sound(turnstile, &go_on)? {
                Some((points, reason)) => {
                    self.end_at(points, reason);
                    Ok(Checked::Whole)
                }
                None => Ok(Checked::Stopped),
            },
        }
    }

    /// The chunks that cannot be decoded, in their order; `None` where stopped.
    fn lost(
        &self,
        coding: &Coding,
        chunks: &[PointChunk],
        go_on: &(impl Fn(u64) -> bool + Sync),
    ) -> Result<Option<Vec<Lost>>, LasError> {
        let stopped = AtomicBool::new(false);
        let lost: Result<Vec<Option<Lost>>, LasError> = chunks
            .par_iter()
            .map_init(Vec::new, |records, chunk| {
                if stopped.load(Ordering::Relaxed) || !go_on(chunk.points) {
                    stopped.store(true, Ordering::Relaxed);
                    return Ok(None);
                }
                records.resize(chunk.points as usize * coding.record_length, 0);
                match self.decode(coding, std::slice::from_ref(chunk), records) {
                    Ok(()) => Ok(None),
                    Err(LasError::Damaged { reason, .. }) => Ok(Some(Lost { chunk: *chunk, reason })),
                    // The disk, or a hand at the file: not the file's own damage.
                    Err(error) => Err(error),
                }
            })
            .collect();
        let lost = lost?;
        Ok((!stopped.into_inner()).then(|| lost.into_iter().flatten().collect()))
    }

    /// The last chunk is not lost where only the header's count does not fit it.
    fn keep_recounted(&mut self, lost: &mut Vec<Lost>) {
        let Some(last) = lost.last().map(|lost| lost.chunk) else { return };
        let Some((chunk, points)) = self.last_recounted().filter(|(chunk, _)| *chunk == last) else { return };
        let PointBody::Chunks { chunks, .. } = &mut self.body else { return };
        chunks.last_mut().into_iter().for_each(|chunk| chunk.points = points);
        lost.pop();
        let (said, there) = (self.header.points, chunk.first + points);
        self.header.points = there;
        self.header.missing += said.saturating_sub(there);
        self.header.notes.push(match there < said {
            true => format!("{there} of its {said} points are there: its last LAZ chunk holds {points}"),
            false => {
                format!("its header says {said} points, its chunks hold {there}; all of them are read")
            }
        });
    }

    fn drop_chunks(&mut self, lost: &[Lost]) {
        let PointBody::Chunks { chunks, .. } = &mut self.body else { return };
        if let Some(Some(mended)) = self.mended.take() {
            *chunks = mended;
        }
        chunks.retain(|chunk| lost.binary_search_by_key(&chunk.first, |lost| lost.chunk.first).is_err());
        let mut first = 0;
        for chunk in chunks {
            chunk.first = first;
            first += chunk.points;
        }
        let points: u64 = lost.iter().map(|lost| lost.chunk.points).sum();
        let notes = &mut self.header.notes;
        for Lost { chunk, reason } in lost.iter().take(MOST_NAMED) {
            let PointChunk { first, points, at, bytes } = chunk;
            let last = first + points - 1;
            notes.push(format!(
                "the points {first} to {last} are lost: their LAZ chunk of {bytes} bytes at byte {at} cannot be \
                 decoded ({reason})"
            ));
        }
        if lost.len() > MOST_NAMED {
            let (more, all) = (lost.len() - MOST_NAMED, lost.len());
            notes.push(format!(
                "{more} further LAZ chunks cannot be decoded: {points} points in {all} are lost"
            ));
        }
        self.header.points -= points;
        self.header.missing += points;
    }

    /// How many points from the front on are right, and why no more are, if so;
    /// `None` where stopped.
    fn sound(
        &self,
        turnstile: &SequentialDecoder,
        go_on: &impl Fn(u64) -> bool,
    ) -> Result<Option<(u64, Option<String>)>, LasError> {
        let all = self.header.points;
        let mut records = Vec::new();
        let mut first = 0;
        while first < all {
            let points = (all - first).min(SKIP);
            if !go_on(points) {
                return Ok(None);
            }
            records.resize(points as usize * self.stored_length(), 0);
            match turnstile.read(first, &mut records) {
                Ok(()) => first += points,
                Err(broken) if broken.unread => {
                    return Err(LasError::io("read", self.path(), std::io::Error::other(broken.reason)));
                }
                Err(broken) => return Ok(Some((broken.sound, Some(broken.reason)))),
            }
        }
        Ok(Some((all, None)))
    }

    fn end_at(&mut self, points: u64, reason: Option<String>) {
        let Some(reason) = reason else { return };
        let promised = self.header.points + self.header.missing;
        self.header.notes.push(format!("{points} of its {promised} points can be read: {reason}"));
        self.header.points = points;
        self.header.missing = promised - points;
    }
}
