//! The daemon: opens the state directory, starts its three loops (watching, working,
//! answering), and stops them in good order. No decision about a cloud or a job
//! is made here.

// In import order, as in src/lib.rs; empty lines keep rustfmt from sorting them.
pub mod job;

pub mod log;
pub mod metrics;

pub mod config;

pub mod queue;

pub mod watch;

pub mod scheduler;

pub mod viewer;

pub mod web;

mod error;
pub mod init;
mod log_loop;
mod scheduler_loop;
pub mod signals;
mod state_dir;
mod systemd;
mod watch_loop;

use std::io::Write;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use sd_notify::NotifyState;
use tokio::net::TcpListener;
use tokio::sync::Notify;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use crate::platform::clock::Clock;
use crate::platform::disk::Disk;
use crate::serve::config::Config;
use crate::serve::metrics::Metrics;
use crate::serve::queue::Store;
use crate::serve::queue::progress::ProgressRegistry;
use crate::serve::scheduler::converter::Converter;
use crate::serve::scheduler::{Engine, EngineContext};
pub use error::DaemonError;
use systemd::tell_systemd;
use web::AppState;

/// Runs until a signal, and returns when all is put away.
pub fn run(config: Config, converter: Arc<dyn Converter>) -> Result<(), DaemonError> {
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .enable_all()
        .build()
        .map_err(DaemonError::Start)?;
    let result = runtime.block_on(serve(config, converter));
    // A conversion that did not stop in time, or a fingerprint of a huge file,
    // may still be at it; nothing it does counts any more.
    runtime.shutdown_timeout(Duration::from_millis(200));
    result
}

async fn serve(config: Config, converter: Arc<dyn Converter>) -> Result<(), DaemonError> {
    let (stop, tracker) = (CancellationToken::new(), TaskTracker::new());
    signals::listen(stop.clone()).map_err(DaemonError::Start)?;
    let disk = Disk::new().refusing_links();
    let config = Arc::new(state_dir::open(config, &disk)?);
    let _lock = state_dir::lock(&config).await?;
    let store = Store::open(&config.database()).await?;
    let listener = listen(config.listen).await?;
    let address = listener.local_addr().map_err(DaemonError::Start)?;
    let tools = EngineContext {
        config: config.clone(),
        store: store.clone(),
        board: ProgressRegistry::default(),
        metrics: Metrics::new()?,
        clock: Clock::System,
        disk,
        converter,
        bell: Arc::new(Notify::new()),
    };
    let shared = shared(&tools, &stop);
    let mut engine = Engine::new(tools, format!("{}-{}", std::process::id(), Clock::System.now()));
    engine.recover().await?;

    let answering = tracker.spawn(answer(listener, shared.clone(), stop.clone()));
    tracker.spawn(watch_loop::run(shared.clone(), stop.clone()));
    tracker.spawn(log_loop::run(store.clone(), stop.clone()));
    tell_where(&config, address);
    tell_systemd(&[NotifyState::Ready]);
    scheduler_loop::run(&mut engine, &shared, &stop).await;

    shared.update_health(|health| health.stopping = true);
    tell_systemd(&[NotifyState::Stopping]);
    engine.stop().await;
    tracker.close();
    if tokio::time::timeout(Duration::from_secs(3), tracker.wait()).await.is_err() {
        answering.abort();
    }
    log_loop::keep(&store).await;
    store.close().await;
    tracing::info!("stopped");
    Ok(())
}

fn shared(tools: &EngineContext, stop: &CancellationToken) -> AppState {
    AppState {
        config: tools.config.clone(),
        store: tools.store.clone(),
        board: tools.board.clone(),
        metrics: tools.metrics.clone(),
        clock: tools.clock.clone(),
        disk: tools.disk.clone(),
        health: Arc::default(),
        bell: tools.bell.clone(),
        stop: stop.clone(),
        streams: web::Streams::default(),
        live: web::Live::default(),
        uploads: web::upload_places(),
        viewer: viewer::Viewer::default(),
        figures: web::Figures::default(),
    }
}

async fn listen(address: SocketAddr) -> Result<TcpListener, DaemonError> {
    TcpListener::bind(address).await.map_err(|source| DaemonError::Listen { address, source })
}

async fn answer(listener: TcpListener, shared: AppState, stop: CancellationToken) {
    let config = shared.config.clone();
    web::serve(listener, web::router(shared), config.access.base(), stop).await;
}

/// What a person who starts the daemon wants to know, on stdout.
fn tell_where(config: &Config, address: SocketAddr) {
    let mut text = format!("Lodestone {}\n", env!("CARGO_PKG_VERSION"));
    text += &format!("  drop LAS/LAZ files, or folders of tiles, into  {}\n", config.inbox().display());
    for folder in &config.watch {
        text += &format!("  or into                                        {}\n", folder.display());
    }
    text += &format!("  octrees appear under                           {}\n", config.octrees().display());
    text += &format!("  look at                                        http://{}/\n", reachable(address));
    if let Some(url) = &config.access.public_url {
        text += &format!("  or, as everybody, at                           {}/\n", url.text());
    }
    if config.access.token.is_some() {
        text += "  which asks for the token\n";
    }
    // Nobody may be reading; that is no reason to stop.
    let _ = std::io::stdout().write_all(text.as_bytes()).and_then(|()| std::io::stdout().flush());
}

/// The address as it can be given to a browser: "all addresses" is none.
fn reachable(address: SocketAddr) -> String {
    if address.ip().is_unspecified() { format!("localhost:{}", address.port()) } else { address.to_string() }
}
