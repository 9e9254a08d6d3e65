//! Reads COPC files with copc-streaming: all pages of the hierarchy, all nodes, every point in
//! its node's box by that reader's own reckoning. Arguments: for each file its path, and where
//! the bytes of all its records go. Prints the number of nodes with points, a line a file.

use std::error::Error;
use std::fs::File;
use std::future::Future;
use std::io::Write;
use std::pin::pin;
use std::task::{Context, Poll, Waker};

use copc_streaming::{CopcStreamingReader, Fields, FileSource};

/// The result of a future of files, which never really waits.
fn wait<T>(future: impl Future<Output = T>) -> T {
    let mut future = pin!(future);
    let mut context = Context::from_waker(Waker::noop());
    loop {
        if let Poll::Ready(value) = future.as_mut().poll(&mut context) {
            return value;
        }
    }
}

fn read(path: &str, output: &str) -> Result<usize, Box<dyn Error>> {
    let mut reader = wait(CopcStreamingReader::open(FileSource::open(path)?))?;
    wait(reader.load_all_hierarchy())?;
    let root = reader.copc_info().root_bounds();
    let entries: Vec<_> = reader.entries().map(|(key, entry)| (*key, entry.point_count)).collect();
    let (mut output, mut nodes) = (File::create(output)?, 0);
    for (key, points) in entries.into_iter().filter(|(_, points)| *points > 0) {
        let chunk = wait(reader.fetch_chunk(&key, Fields::ALL))?;
        if chunk.point_count() != points as usize {
            return Err(format!("{key:?} has {} points, not {points}", chunk.point_count()).into());
        }
        let bounds = key.bounds(&root);
        for at in chunk.positions().ok_or("no positions")? {
            if !(0..3).all(|axis| bounds.min[axis] <= at[axis] && at[axis] <= bounds.max[axis]) {
                return Err(format!("{key:?}: {at:?} lies outside of {bounds:?}").into());
            }
        }
        output.write_all(chunk.cloud().raw_bytes())?;
        nodes += 1;
    }
    Ok(nodes)
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    for pair in arguments.chunks_exact(2) {
        println!("{}", read(&pair[0], &pair[1]).map_err(|error| format!("{}: {error}", pair[0]))?);
    }
    Ok(())
}
