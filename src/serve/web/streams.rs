//! The places for event streams. Nobody can see whether a stream is read while
//! little is said, so one that has lasted gives way to a newcomer where all places
//! are taken: readers come back by themselves, and what holds places to no purpose
//! does not.

use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tokio_util::sync::CancellationToken;

/// Streams at a time; each asks the queue twice a second.
const MOST: usize = 32;
/// What every stream has at least.
const LEAST: Duration = Duration::from_secs(60);

/// All places. Cheap to clone.
#[derive(Debug, Clone, Default)]
pub struct Streams(Arc<Mutex<Vec<Open>>>);

#[derive(Debug)]
struct Open {
    peer: Option<IpAddr>,
    since: Instant,
    gone: CancellationToken,
    /// Tells it from others.
    mark: Arc<()>,
}

/// A stream's place; dropped, it is free.
pub(super) struct StreamPlace {
    gone: CancellationToken,
    mark: Arc<()>,
    all: Streams,
}

impl Streams {
    fn lock(&self) -> MutexGuard<'_, Vec<Open>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// How many are open.
    pub fn count(&self) -> usize {
        self.lock().len()
    }

    /// A place, if need be that of the oldest stream of whoever has most of those
    /// that have lasted. None where all are young.
    pub(super) fn open(&self, peer: Option<IpAddr>, now: Instant) -> Option<StreamPlace> {
        let mut open = self.lock();
        if open.len() >= MOST {
            let mut held: HashMap<Option<IpAddr>, usize> = HashMap::new();
            open.iter().for_each(|stream| *held.entry(stream.peer).or_default() += 1);
            let age = |stream: &Open| now.saturating_duration_since(stream.since);
            let lasted = open.iter().enumerate().filter(|(_, stream)| age(stream) >= LEAST);
            let (index, _) = lasted.max_by_key(|(_, stream)| (held[&stream.peer], age(stream)))?;
            open.swap_remove(index).gone.cancel();
        }
        let (gone, mark) = (CancellationToken::new(), Arc::new(()));
        open.push(Open { peer, since: now, gone: gone.clone(), mark: mark.clone() });
        Some(StreamPlace { gone, mark, all: self.clone() })
    }
}

impl StreamPlace {
    /// Ends when the stream has to give way.
    pub async fn must_go(&self) {
        self.gone.cancelled().await;
    }
}

impl Drop for StreamPlace {
    fn drop(&mut self) {
        self.all.lock().retain(|stream| !Arc::ptr_eq(&stream.mark, &self.mark));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_oldest_gives_way_once_it_has_lasted() {
        let (streams, start) = (Streams::default(), Instant::now());
        let other = "10.0.0.2".parse().ok();
        let alone = streams.open(other, start).expect("a place");
        let greedy: Vec<_> = (1..MOST)
            .map(|i| streams.open(None, start + Duration::from_secs(i as u64)).expect("a place"))
            .collect();
        assert!(streams.open(other, start + LEAST / 2).is_none());
        let new = streams.open(other, start + LEAST * 2).expect("a place");
        assert!(
            greedy[0].gone.is_cancelled() && !alone.gone.is_cancelled() && !greedy[1].gone.is_cancelled()
        );
        assert_eq!(streams.count(), MOST);
        drop(greedy);
        assert_eq!(streams.count(), 2);
        drop((alone, new));
        assert_eq!(streams.count(), 0);
    }
}
