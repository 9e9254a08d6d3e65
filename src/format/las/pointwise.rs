//! Chunks of the point formats 0 to 5: they do not say how many points and bytes they
//! have. What the chunk table does not tell only decoding does.

use super::LasError;
use super::behind::by_share;
use super::chunks::{ChunkLayout, Chunking, Listed, Located, Locator, PointChunk};
use super::declared_counts::{Behind, Evidence, ResolvedCounts, judge};
use super::explore::{Explored, ExploredTo, Explorer};
use super::{ReadMode, chunk_table};

impl Locator<'_> {
    /// Chunks of `each` points, of which the last may have fewer.
    pub(super) fn pointwise(
        &self,
        mut listed: Listed,
        each: u32,
        notes: &mut Vec<String>,
    ) -> Result<Located, LasError> {
        let before = listed.chunks.last().map_or(0, |last| last.first);
        let fits = |count: u64| match listed.chunks.is_empty() {
            true => count == 0,
            false => count > before && count <= before + u64::from(each),
        };
        // Room for a further chunk is not passed over because the count agrees.
        let spare = listed.limit - listed.end;
        let fitting = match listed.trouble {
            Some(_) => None,
            None if spare > self.coding.record_length as u64 => None,
            None if listed.chunks.is_empty() => (self.claims.said() == 0 && listed.is_whole()).then_some(0),
            None => self.claims.candidates().find(|count| fits(*count)),
        };
        if let Some(points) = fitting {
            if spare > 0 {
                notes.push(format!("{spare} bytes between its chunks and their table belong to nothing"));
            }
            if let Some(last) = listed.chunks.last_mut() {
                last.points = points - last.first;
            }
            return Ok(self.counted(ChunkLayout::Chunks(listed.chunks), points));
        }
        if listed.is_whole() && !listed.chunks.is_empty() {
            return self.count_last(listed, u64::from(each));
        }
        let reason = match &listed.trouble {
            Some(reason) => reason.clone(),
            None => format!(
                "its chunk table lists {} chunks, and {} bytes behind those",
                listed.chunks.len(),
                listed.limit - listed.end
            ),
        };
        self.stream(Some(each), self.start + 8, listed.limit, Some(reason), notes)
    }

    /// The table accounts for every byte, but the header counts what it cannot hold.
    fn count_last(&self, mut listed: Listed, each: u64) -> Result<Located, LasError> {
        let Some(last) = listed.chunks.last_mut() else {
            return Ok(self.counted(ChunkLayout::Chunks(Vec::new()), 0));
        };
        let layout = ChunkLayout::Stream {
            start: last.at,
            end: last.at + last.bytes,
            chunk_points: None,
            points: each,
            settled: true,
        };
        // Behind the last point a decoder may go on for a few more without another
        // byte. What it invents then lies anywhere.
        let (mut all, mut sound) = (0, 0);
        let explored = self.explore(&layout, each, |record| {
            all += 1;
            if !self.reach.tells() || self.reach.holds(record) {
                sound = all;
            }
        })?;
        let points = explored.points.min(sound);
        last.points = points;
        let there = listed.points();
        if points == 0 {
            listed.chunks.pop();
        }
        let behind = Behind::Points;
        let evidence =
            Evidence { claims: self.claims, room: there, torn: false, behind, header_is_exact: false };
        let reason = format!("its chunk table lists {} chunks, and no byte is left", listed.chunks.len());
        let (verdict, complete) = (judge(&evidence), false);
        Ok(Located { layout: ChunkLayout::Chunks(listed.chunks), verdict, complete, reason })
    }

    /// Chunks of any number of points. Without their table nobody knows where they begin;
    /// but where a single one is not in it, that is what is left.
    pub(super) fn variable(&self, mut listed: Listed, notes: &mut Vec<String>) -> Result<Located, LasError> {
        if listed.chunks.is_empty() && self.claims.said() > 0 && listed.trouble.is_none() {
            let said = self.claims.said();
            listed.trouble = Some(format!("its chunk table is empty, its header says {said} points"));
        }
        if let Some(reason) = listed.trouble {
            if self.reading != ReadMode::Readable {
                let path = self.source.path().to_path_buf();
                return Err(LasError::Damaged { path, place: "every chunk".to_string(), reason });
            }
            let reason = format!("{reason}; without it nobody knows where its chunks begin");
            notes.push(reason.clone());
            let verdict = ResolvedCounts::TooFew { said: self.claims.largest(), there: 0 };
            return Ok(Located { layout: ChunkLayout::Chunks(Vec::new()), verdict, complete: false, reason });
        }
        let (there, spare) = (listed.points(), listed.limit - listed.end);
        let left = self.claims.against(there).saturating_sub(there);
        let mut reason = "its chunk table says so".to_string();
        if spare > 0 && left > 0 {
            reason = "its chunk table lacks a chunk".to_string();
            notes.push(format!(
                "{reason}: the last {left} points are taken to be in the {spare} bytes in front of it"
            ));
            listed.chunks.push(PointChunk { first: there, points: left, at: listed.end, bytes: spare });
        } else if spare > 0 {
            reason = format!("{spare} bytes between its chunks and their table belong to nothing");
            notes.push(reason.clone());
        }
        let (claims, behind) = (self.claims, Behind::Points);
        let torn = spare > 0 && left == 0;
        let evidence = Evidence { claims, room: listed.points(), torn, behind, header_is_exact: false };
        if listed.points() > self.most() {
            let points = listed.points();
            let reason = format!("its chunk table promises {points} points, more than its bytes can hold");
            return Err(LasError::header(self.source.path(), reason));
        }
        let complete = spare == 0 && self.claims.are(listed.points());
        Ok(Located {
            layout: ChunkLayout::Chunks(listed.chunks),
            verdict: judge(&evidence),
            complete,
            reason,
        })
    }

    /// One point behind the other. Where it does not take long, or where what can be read
    /// is asked for, it is decoded to see how many there are.
    pub(super) fn stream(
        &self,
        chunk_points: Option<u32>,
        start: u64,
        end: u64,
        reason: Option<String>,
        notes: &mut Vec<String>,
    ) -> Result<Located, LasError> {
        let layout =
            |points: u64, settled: bool| ChunkLayout::Stream { start, end, chunk_points, points, settled };
        if let (ReadMode::Strict, Some(reason)) = (self.reading, &reason) {
            let (path, place) = (self.source.path().to_path_buf(), "its chunk table".to_string());
            return Err(LasError::Damaged { path, place, reason: reason.clone() });
        }
        if let Some(reason) = &reason {
            notes.push(format!("{reason}; it can only be read from front to back"));
        }
        let said = self.claims.said().min(self.most());
        let agreed = self.claims.by_return == self.claims.said();
        // LASzip 1 knew no chunks: its files are whole without a table.
        if self.chunking == Chunking::Whole && said > 0 && self.reading != ReadMode::Readable {
            return Ok(self.counted(layout(said, agreed), said));
        }
        let mut counts: Vec<u64> = self.claims.candidates().filter(|count| *count <= self.most()).collect();
        counts.sort_unstable();
        let bounded = self.reading != ReadMode::Readable;
        let mut explorer = Explorer::new(self.source, self.coding, &layout(u64::MAX, true), bounded)?;
        let chunks = |points: u64| chunk_points.map_or(0, |each| points.div_ceil(u64::from(each)));
        let mut complete = self.counted(layout(said, false), said);
        complete.complete = self.chunking == Chunking::Whole;
        complete.reason = reason.clone().unwrap_or_default();
        // What it says may be no use where its place still is.
        let table = chunk_points.map(|_| self.table_place()).transpose()?;
        for count in counts {
            let explored = self.read(explorer.go_to(count, |_| {}))?;
            match explored.end {
                ExploredTo::Bound => return Ok(complete),
                ExploredTo::Points
                    if chunk_table::is_end(self.source, explored.at, end, chunks(count), table)? =>
                {
                    return Ok(Located {
                        layout: layout(count, true),
                        verdict: ResolvedCounts::Counted(count),
                        ..complete
                    });
                }
                ExploredTo::Points => {}
                ExploredTo::Broken(broken) => {
                    let reason = complete.reason.clone();
                    let reason = if reason.is_empty() { broken.reason } else { reason };
                    let verdict =
                        ResolvedCounts::TooFew { said: self.claims.largest(), there: explored.points };
                    return Ok(Located {
                        layout: layout(explored.points, true),
                        verdict,
                        reason,
                        ..complete
                    });
                }
            }
        }
        let counted = self.claims.largest().min(self.most());
        let length = self.coding.record_length;
        let (mut all, mut inside, mut sound) = (counted, 0, counted);
        let explored = self.read(explorer.go_to(u64::MAX, |records| {
            for record in records.chunks_exact(length) {
                all += 1;
                if self.reach.holds(record) {
                    (inside, sound) = (inside + 1, all);
                }
            }
        }))?;
        let (behind, there) = match self.reach.tells() {
            true => {
                let there = sound.min(explored.points).max(counted);
                (by_share(inside, there - counted), there)
            }
            false => (Behind::Unclear, explored.points),
        };
        let torn = explored.at < end || !matches!(explored.end, ExploredTo::Points);
        let evidence = Evidence { claims: self.claims, room: there, torn, behind, header_is_exact: false };
        let verdict = judge(&evidence);
        if let (ResolvedCounts::Counted(points), true) = (verdict, behind != Behind::Nothing) {
            notes.push(format!("what lies behind its {points} points is none, and is ignored"));
        }
        let reason = match explored.end {
            ExploredTo::Broken(broken) => broken.reason,
            _ => complete.reason.clone(),
        };
        Ok(Located { layout: layout(verdict.there(), true), verdict, reason, ..complete })
    }

    /// Where the points' first bytes say that the chunk table is.
    fn table_place(&self) -> Result<u64, LasError> {
        let mut place = [0; 8];
        if self.source.bytes().saturating_sub(self.start) >= place.len() as u64 {
            self.source.read_exact_at(&mut place, self.start)?;
        }
        Ok(u64::from_le_bytes(place))
    }

    fn explore(
        &self,
        layout: &ChunkLayout,
        until: u64,
        mut each: impl FnMut(&[u8]),
    ) -> Result<Explored, LasError> {
        let mut explorer =
            Explorer::new(self.source, self.coding, layout, self.reading != ReadMode::Readable)?;
        let length = self.coding.record_length;
        self.read(explorer.go_to(until, |records| records.chunks_exact(length).for_each(&mut each)))
    }

    /// A disk that fails says nothing of the file's bytes.
    fn read(&self, explored: Explored) -> Result<Explored, LasError> {
        match explored.end {
            ExploredTo::Broken(broken) if broken.unread => {
                Err(LasError::io("read", self.source.path(), std::io::Error::other(broken.reason)))
            }
            _ => Ok(explored),
        }
    }
}
