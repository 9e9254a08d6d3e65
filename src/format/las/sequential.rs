//! LAZ that has to be decoded from front to back: one stream without chunks
//! (LASzip 1), chunks without a table, chunks too large to decode whole.
//!
//! Slices are still asked for from several threads, so there is a turnstile:
//! the slice that is next goes through, a thread with a later one waits for its
//! turn. It never waits for ever: if for some seconds nobody comes for the
//! slices in between (their thread failed, or waits for this very one), it
//! decodes them into nothing and goes on; and a slice that is behind starts
//! over. So every order gives the right records, and file order is the fast one.

use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::Duration;

use super::chunks::ChunkLayout;
use super::coding::Coding;
use super::source::FileReader;
use super::stream::{Broken, PointStream, SKIP};

/// How long a thread waits for the slices before its own without seeing any
/// progress. Tests have less of it.
const PATIENCE: Duration = if cfg!(test) { Duration::from_millis(100) } else { Duration::from_secs(3) };

#[derive(Debug)]
pub struct SequentialDecoder {
    source: Arc<FileReader>,
    coding: Coding,
    layout: ChunkLayout,
    state: Mutex<SequentialState>,
    moved: Condvar,
}

#[derive(Debug, Default)]
struct SequentialState {
    stream: Option<PointStream>,
    /// The first point that was not decoded yet.
    next: u64,
    broken: Option<Broken>,
}

impl SequentialDecoder {
    pub fn new(source: Arc<FileReader>, coding: Coding, layout: ChunkLayout) -> SequentialDecoder {
        SequentialDecoder { source, coding, layout, state: Mutex::default(), moved: Condvar::new() }
    }

    /// Fills `records` with the points from `first` on.
    pub fn read(&self, first: u64, records: &mut [u8]) -> Result<(), Broken> {
        let points = (records.len() / self.coding.record_length) as u64;
        // Nothing panics while the lock is held that is not caught; a poisoned
        // state would be as good as any.
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        if first == 0 {
            *state = SequentialState::default();
        }
        loop {
            if let Some(broken) = &state.broken
                && first + points > broken.readable
            {
                return Err(broken.clone());
            }
            if first <= state.next {
                break;
            }
            let before = state.next;
            let (woken, wait) =
                self.moved.wait_timeout(state, PATIENCE).unwrap_or_else(PoisonError::into_inner);
            state = woken;
            if wait.timed_out() && state.next == before {
                break;
            }
        }
        let result = self.advance(&mut state, first, records);
        if let Err(broken) = &result {
            *state = SequentialState { broken: Some(broken.clone()), ..SequentialState::default() };
        }
        drop(state);
        self.moved.notify_all();
        result
    }

    fn advance(&self, state: &mut SequentialState, first: u64, records: &mut [u8]) -> Result<(), Broken> {
        let mut stream = match state.stream.take() {
            Some(stream) if stream.decoded <= first => stream,
            _ => PointStream::new(self.source.clone(), &self.layout),
        };
        let mut nothing = Vec::new();
        while stream.decoded < first {
            let points = (first - stream.decoded).min(SKIP);
            nothing.resize(points as usize * self.coding.record_length, 0);
            stream.decode(&self.coding, &self.layout, &mut nothing)?;
        }
        stream.decode(&self.coding, &self.layout, records)?;
        state.next = stream.decoded;
        state.stream = Some(stream);
        Ok(())
    }
}
