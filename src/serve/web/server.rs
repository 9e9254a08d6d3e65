//! Serves connections, bounded in number and in time: half a header, silence and an
//! answer that nobody takes end after some seconds, and where all places are
//! taken, the connection that has been of no use for longest gives way, first those
//! of the address that holds most. A few places beyond are kept for probes.

use std::convert::Infallible;
use std::net::IpAddr;
use std::pin::pin;
use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::Router;
use axum::body::Body;
use axum::http::{HeaderValue, Request, Response, StatusCode, header};
use axum::response::IntoResponse;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::{Service, service_fn};
use hyper_util::rt::TokioIo;
use hyper_util::service::TowerToHyperService;
use tokio::net::{TcpListener, TcpStream};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use super::refusal::ApiError;
use super::seats::{Admitted, Place, Seats};
use super::watched::{Counted, Watched};

/// How often a connection's time limits are looked at.
const LOOK: Duration = Duration::from_secs(1);
/// Of what was read and not yet understood, and written and not yet sent.
const BUFFER: usize = 64 * 1024;
/// A pause after an error of accepting, as the lack of file handles.
const PAUSE: Duration = Duration::from_millis(100);

/// Who is at the other end; among a request's extensions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Peer(pub IpAddr);

/// Serves until told to stop, then until the requests in hand are answered. `base` is
/// in front of every path of ours.
pub async fn serve(listener: TcpListener, router: Router, base: &str, stop: CancellationToken) {
    let seats = Seats::default();
    let connections = TaskTracker::new();
    let probes: Arc<[String]> =
        ["/healthz", "/readyz"].iter().flat_map(|path| [path.to_string(), format!("{base}{path}")]).collect();
    loop {
        let accepted = tokio::select! {
            accepted = listener.accept() => accepted,
            () = stop.cancelled() => break,
        };
        match accepted {
            Ok((stream, address)) => {
                let place = seats.admit(address.ip(), Instant::now());
                let connection = Connection { place, router: router.clone(), probes: probes.clone() };
                connections.spawn(connection.run(stream, stop.clone()));
            }
            Err(error) => {
                // Out of file handles, most likely; spinning would not help.
                tracing::warn!(%error, "could not accept a connection");
                seats.make_room(Instant::now());
                tokio::time::sleep(PAUSE).await;
            }
        }
    }
    connections.close();
    connections.wait().await;
}

struct Connection {
    place: Admitted,
    router: Router,
    probes: Arc<[String]>,
}

impl Connection {
    async fn run(self, stream: TcpStream, stop: CancellationToken) {
        let seat = self.place.seat.clone();
        // Events are small, and late if they wait for more.
        let _ = stream.set_nodelay(true);
        let io = TokioIo::new(Watched::new(stream, seat.clone()));
        let service = service_fn(|request| self.answer(request));
        let mut connection = pin!(http1::Builder::new().max_buf_size(BUFFER).serve_connection(io, service));
        let mut look = tokio::time::interval(LOOK);
        let mut is_stopping = false;
        loop {
            tokio::select! {
                // How a connection ends is its peer's affair.
                _ = connection.as_mut() => return,
                () = seat.must_go() => return,
                _ = look.tick() => {
                    if seat.is_overdue(Instant::now()) {
                        return;
                    }
                }
                () = stop.cancelled(), if !is_stopping => {
                    is_stopping = true;
                    connection.as_mut().graceful_shutdown();
                }
            }
        }
    }

    async fn answer(&self, mut request: Request<Incoming>) -> Result<Response<Counted>, Infallible> {
        let seat = &self.place.seat;
        seat.begin_answer(Instant::now());
        let is_probe = self.probes.iter().any(|path| path == request.uri().path());
        let is_extra = seat.place() == Place::Reserved;
        request.extensions_mut().insert(Peer(seat.address()));
        let mut answer = if is_extra && !is_probe {
            let text = "all connections are taken; try again in a moment";
            let refusal = ApiError::new(StatusCode::SERVICE_UNAVAILABLE, text);
            ([(header::RETRY_AFTER, "2")], refusal).into_response()
        } else {
            let service = TowerToHyperService::new(self.router.clone());
            service.call(request.map(Body::new)).await.unwrap_or_else(|error| match error {})
        };
        if is_extra {
            answer.headers_mut().insert(header::CONNECTION, HeaderValue::from_static("close"));
        }
        Ok(answer.map(|body| Counted::new(body, seat.clone())))
    }
}
