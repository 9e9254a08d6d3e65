//! The places for connections: who has one, how long it has been of no use, and who
//! gives way to a newcomer.

use std::collections::HashMap;
use std::net::{IpAddr, Ipv6Addr};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tokio_util::sync::CancellationToken;

/// Connections at a time.
const MOST: usize = 256;
/// And beyond them, for requests of `/healthz` and `/readyz` alone.
const RESERVED: usize = 64;
/// From a request's first byte, or from the connection's beginning, to its last
/// line of headers.
const HEAD: Duration = Duration::from_secs(10);
/// Between two requests.
const IDLE: Duration = Duration::from_secs(60);
/// An answer of which nothing is taken.
const BLOCKED: Duration = Duration::from_secs(20);
/// An answer that does not get on for whatever reason. Handlers have less time than
/// that, and streams say something more often.
const SILENT: Duration = Duration::from_secs(60);
/// An answer that was not taken for so long gives way to a newcomer.
const SLOW: Duration = Duration::from_secs(2);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Place {
    Usual,
    /// Beyond the usual ones, for a probe.
    Reserved,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// Nothing of the next request has come.
    Idle,
    /// The head of a request is coming.
    Head,
    Answering,
}

#[derive(Debug)]
struct Doing {
    phase: Phase,
    /// When the phase began.
    since: Instant,
    /// When a byte last came or went.
    moved: Instant,
    /// Since when nothing of an answer has been taken.
    blocked: Option<Instant>,
}

/// What is known of a connection.
#[derive(Debug)]
pub(super) struct Seat {
    number: u64,
    address: IpAddr,
    place: Place,
    doing: Mutex<Doing>,
    gone: CancellationToken,
}

/// A connection's hold of its place; dropped, the place is free.
#[derive(Debug)]
pub(super) struct Admitted {
    pub seat: Arc<Seat>,
    all: Seats,
}

impl Drop for Admitted {
    fn drop(&mut self) {
        lock(&self.all.0).seats.remove(&self.seat.number);
    }
}

/// All places. Cheap to clone.
#[derive(Debug, Clone, Default)]
pub(super) struct Seats(Arc<Mutex<TakenSeats>>);

#[derive(Debug, Default)]
struct TakenSeats {
    next: u64,
    seats: HashMap<u64, Arc<Seat>>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Seats {
    /// A place for a new connection: a usual one, if need be that of a connection
    /// that is of no use; else one of those kept for probes.
    pub fn admit(&self, address: IpAddr, now: Instant) -> Admitted {
        let mut taken = lock(&self.0);
        let seats = taken.living();
        let usual: Vec<&Arc<Seat>> = seats.iter().filter(|seat| seat.place == Place::Usual).collect();
        let place = if usual.len() < MOST || give_way(&usual, now) {
            Place::Usual
        } else {
            let reserved: Vec<_> = seats.iter().filter(|seat| seat.place == Place::Reserved).collect();
            if reserved.len() >= RESERVED
                && let Some(first) = reserved.iter().min_by_key(|seat| seat.number)
            {
                first.gone.cancel();
            }
            Place::Reserved
        };
        taken.next += 1;
        let number = taken.next;
        let doing = Doing { phase: Phase::Head, since: now, moved: now, blocked: None };
        let seat = Arc::new(Seat {
            number,
            address: network(address),
            place,
            doing: Mutex::new(doing),
            gone: CancellationToken::new(),
        });
        taken.seats.insert(number, seat.clone());
        Admitted { seat, all: self.clone() }
    }

    /// Ends a connection that is of no use, where there is one.
    pub fn make_room(&self, now: Instant) {
        let seats = lock(&self.0).living();
        give_way(&seats.iter().collect::<Vec<_>>(), now);
    }
}

impl TakenSeats {
    /// Those whose connections have not been told to go.
    fn living(&self) -> Vec<Arc<Seat>> {
        self.seats.values().filter(|seat| !seat.gone.is_cancelled()).cloned().collect()
    }
}

/// Ends one of these that is of no use: of those of the address that holds most, the
/// one that has been so for longest.
fn give_way(seats: &[&Arc<Seat>], now: Instant) -> bool {
    let mut held: HashMap<IpAddr, usize> = HashMap::new();
    for seat in seats {
        *held.entry(seat.address).or_default() += 1;
    }
    let useless = seats.iter().filter_map(|seat| Some((held[&seat.address], seat.useless(now)?, seat)));
    let Some((_, _, seat)) = useless.max_by_key(|(held, time, _)| (*held, *time)) else { return false };
    seat.gone.cancel();
    true
}

/// What one peer has at its command: an address, or a network of IPv6.
fn network(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(v6) => IpAddr::V6(Ipv6Addr::from_bits(v6.to_bits() & !u128::from(u64::MAX))),
        v4 => v4,
    }
}

impl Seat {
    pub fn address(&self) -> IpAddr {
        self.address
    }

    pub fn place(&self) -> Place {
        self.place
    }

    /// Ends when the connection has to give way.
    pub async fn must_go(&self) {
        self.gone.cancelled().await;
    }

    pub fn read(&self, now: Instant) {
        let mut doing = lock(&self.doing);
        doing.moved = now;
        if doing.phase == Phase::Idle {
            (doing.phase, doing.since) = (Phase::Head, now);
        }
    }

    pub fn wrote(&self, now: Instant) {
        let mut doing = lock(&self.doing);
        (doing.moved, doing.blocked) = (now, None);
    }

    /// Something is to be written, and the other side takes nothing.
    pub fn is_blocked(&self, now: Instant) {
        lock(&self.doing).blocked.get_or_insert(now);
    }

    pub fn begin_answer(&self, now: Instant) {
        let mut doing = lock(&self.doing);
        (doing.phase, doing.since) = (Phase::Answering, now);
    }

    pub fn end_answer(&self, now: Instant) {
        let mut doing = lock(&self.doing);
        (doing.phase, doing.since) = (Phase::Idle, now);
    }

    /// Whether a time limit is over.
    pub fn is_overdue(&self, now: Instant) -> bool {
        let doing = lock(&self.doing);
        let over = |since: Instant, limit: Duration| now.saturating_duration_since(since) >= limit;
        let phase = match doing.phase {
            Phase::Idle => over(doing.since, IDLE),
            Phase::Head => over(doing.since, HEAD),
            Phase::Answering => over(doing.since.max(doing.moved), SILENT),
        };
        phase || doing.blocked.is_some_and(|blocked| over(blocked, BLOCKED))
    }

    /// How long it has been of no use, where it is of none.
    fn useless(&self, now: Instant) -> Option<Duration> {
        let doing = lock(&self.doing);
        let blocked = doing.blocked.map(|since| now.saturating_duration_since(since));
        match doing.phase {
            Phase::Idle | Phase::Head => Some(now.saturating_duration_since(doing.since)),
            Phase::Answering => blocked.filter(|time| *time >= SLOW),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ip(text: &str) -> IpAddr {
        text.parse().expect("an address")
    }

    impl std::ops::Deref for Admitted {
        type Target = Seat;
        fn deref(&self) -> &Seat {
            &self.seat
        }
    }

    /// As many connections as there are places, from one address, all answering.
    fn busy(seats: &Seats, now: Instant) -> Vec<Admitted> {
        let all: Vec<_> = (0..MOST).map(|_| seats.admit(ip("10.0.0.1"), now)).collect();
        all.iter().for_each(|seat| seat.begin_answer(now));
        all
    }

    fn gone(seats: &[Admitted]) -> Vec<usize> {
        (0..seats.len()).filter(|i| seats[*i].gone.is_cancelled()).collect()
    }

    #[test]
    fn the_longest_idle_gives_way() {
        let (seats, start) = (Seats::default(), Instant::now());
        let all = busy(&seats, start);
        all[7].end_answer(start + Duration::from_secs(1));
        all[8].end_answer(start + Duration::from_secs(2));
        let now = start + Duration::from_secs(3);
        let first = seats.admit(ip("10.0.0.2"), now);
        first.begin_answer(now);
        assert_eq!((first.place(), gone(&all)), (Place::Usual, vec![7]));
        // It is not counted any more, though its connection has not ended yet.
        let second = seats.admit(ip("10.0.0.2"), now);
        assert_eq!((second.place(), gone(&all)), (Place::Usual, vec![7, 8]));
    }

    #[test]
    fn the_address_that_holds_most_gives_way_first() {
        let (seats, start) = (Seats::default(), Instant::now());
        let patient = seats.admit(ip("10.0.0.9"), start);
        let many: Vec<_> = (1..MOST).map(|_| seats.admit(ip("10.0.0.1"), start)).collect();
        let _new = seats.admit(ip("10.0.0.2"), start + Duration::from_secs(1));
        assert!(!patient.gone.is_cancelled());
        assert_eq!(gone(&many).len(), 1);
        // One network of IPv6 is one peer.
        assert_eq!(network(ip("2001:db8::1:2")), network(ip("2001:db8::ffff:0:0:7")));
        assert_ne!(network(ip("2001:db8::1")), network(ip("2001:db8:0:1::1")));
        assert_eq!(network(ip("::ffff:10.0.0.1")), ip("10.0.0.1"));
    }

    #[test]
    fn probes_have_places_of_their_own() {
        let (seats, now) = (Seats::default(), Instant::now());
        let all = busy(&seats, now);
        let reserved: Vec<_> = (0..=RESERVED).map(|_| seats.admit(ip("10.0.0.2"), now)).collect();
        assert!(reserved.iter().all(|seat| seat.place() == Place::Reserved));
        assert_eq!((gone(&all).len(), gone(&reserved)), (0, vec![0]));
        drop(all);
        assert_eq!(seats.admit(ip("10.0.0.2"), now).place(), Place::Usual);
    }

    #[test]
    fn answers_that_nobody_takes_give_way_and_end() {
        let (seats, start) = (Seats::default(), Instant::now());
        let all = busy(&seats, start);
        all[3].is_blocked(start);
        all[4].is_blocked(start);
        all[4].wrote(start + Duration::from_secs(1));
        assert_eq!(seats.admit(ip("10.0.0.2"), start + SLOW).place(), Place::Usual);
        assert_eq!(gone(&all), [3]);
        let late = start + BLOCKED;
        all[5].is_blocked(start);
        assert!(all[5].is_overdue(late) && !all[4].is_overdue(late));
        assert!(all[4].is_overdue(start + Duration::from_secs(1) + SILENT));
    }

    #[test]
    fn heads_and_silence_have_their_time() {
        let (seats, start) = (Seats::default(), Instant::now());
        let seat = seats.admit(ip("::1"), start);
        // A byte now and then does not help.
        seat.read(start + HEAD / 2);
        assert!(!seat.is_overdue(start + HEAD / 2) && seat.is_overdue(start + HEAD));
        seat.begin_answer(start);
        seat.end_answer(start);
        assert!(!seat.is_overdue(start + HEAD) && seat.is_overdue(start + IDLE));
        seat.read(start + IDLE / 2);
        assert!(seat.is_overdue(start + IDLE / 2 + HEAD));
    }
}
