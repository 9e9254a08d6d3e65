//! How many points there are, when the header's counts and the file disagree.
//!
//! A header has one count up to version 1.3 and two since: the 32-bit one of
//! old stays beside the 64-bit one. Writers forget either, and the length of
//! the file is the judge.

/// The counts that a header has.
#[derive(Debug, Clone, Copy)]
pub struct Claims {
    pub legacy: u64,
    /// Only in version 1.4.
    pub large: Option<u64>,
}

/// More points than are really there.
#[derive(Debug, PartialEq, Eq)]
pub struct TooMany {
    pub said: u64,
}

impl Claims {
    pub fn of(raw: &las::raw::Header) -> Claims {
        Claims {
            legacy: u64::from(raw.number_of_point_records),
            large: raw.large_file.map(|large| large.number_of_point_records),
        }
    }

    /// The counts that are not zero, the one to believe first in front.
    pub fn candidates(self) -> impl Iterator<Item = u64> {
        self.large.into_iter().chain([self.legacy]).filter(|count| *count > 0)
    }

    /// What the header says if nothing contradicts it.
    pub fn said(self) -> u64 {
        self.candidates().next().unwrap_or(0)
    }

    pub fn largest(self) -> u64 {
        self.candidates().max().unwrap_or(0)
    }

    /// Whether one of the counts is this.
    pub fn are(self, points: u64) -> bool {
        self.candidates().any(|count| count == points) || self.said() == points
    }

    pub fn note_disagreement(self, notes: &mut Vec<String>) {
        // Only that of old may be left at 0: points beyond its 32 bits, and the
        // formats from 6 on, have no place there.
        if let Some(large) = self.large
            && self.legacy > 0
            && large != self.legacy
        {
            notes.push(format!(
                "its header has two counts of points that differ: {} and {large}",
                self.legacy
            ));
        }
    }

    /// The true count of a plain LAS file with room for `room` whole records;
    /// `rest` bytes are left behind those.
    pub fn judge(self, room: u64, rest: u64, notes: &mut Vec<String>) -> Result<u64, TooMany> {
        self.note_disagreement(notes);
        if self.candidates().any(|count| count == room) {
            return Ok(room);
        }
        let fitting = self.candidates().find(|count| *count < room);
        let said = match fitting {
            Some(said) => said,
            None if self.largest() == 0 => 0,
            None => return Err(TooMany { said: self.largest() }),
        };
        if said == room {
            return Ok(said);
        }
        // Behind the points that the header counts there is something. When it
        // is whole records to the last byte, they are points: a writer died
        // before it could count them, or its counter was too small.
        if rest == 0 {
            notes.push(format!("its header says {said} points, the file holds {room}; all of them are read"));
            return Ok(room);
        }
        notes.push(format!("bytes behind its {said} points belong to nothing and are ignored"));
        Ok(said)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn judge(legacy: u64, large: Option<u64>, room: u64, rest: u64) -> (Result<u64, TooMany>, usize) {
        let mut notes = Vec::new();
        (Claims { legacy, large }.judge(room, rest, &mut notes), notes.len())
    }

    #[test]
    fn what_agrees_is_believed_without_a_word() {
        assert_eq!(judge(100, None, 100, 0), (Ok(100), 0));
        assert_eq!(judge(100, None, 100, 7), (Ok(100), 0));
        assert_eq!(judge(0, Some(100), 100, 0), (Ok(100), 0));
        assert_eq!(judge(0, None, 0, 0), (Ok(0), 0));
    }

    #[test]
    fn of_two_counts_the_one_that_the_file_proves_wins() {
        assert_eq!(judge(90, Some(100), 100, 0), (Ok(100), 1));
        assert_eq!(judge(100, Some(90), 100, 3), (Ok(100), 1));
        assert_eq!(judge(100, Some(1 << 40), 100, 0), (Ok(100), 1));
        assert_eq!(judge(100, Some(0), 100, 0), (Ok(100), 1));
    }

    #[test]
    fn too_few_in_the_header_is_a_note_too_many_an_error() {
        assert_eq!(judge(90, None, 100, 0), (Ok(100), 1));
        assert_eq!(judge(0, None, 100, 0), (Ok(100), 1));
        assert_eq!(judge(90, None, 100, 5), (Ok(90), 1));
        assert_eq!(judge(101, None, 100, 5), (Err(TooMany { said: 101 }), 0));
        assert_eq!(judge(1, Some(0), 0, 5), (Err(TooMany { said: 1 }), 1));
    }
}
