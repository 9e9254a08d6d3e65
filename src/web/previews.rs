//! An octree's pictures, as the API tells of them and serves them.
//!
//! A name may stand for another octree tomorrow. So an address from the API
//! carries a stamp of its pictures and may be kept for ever; one without is asked
//! for again each time, by a tag made of the bytes themselves: times are too
//! coarse to tell two octrees of one second apart.

use axum::body::{Body, to_bytes};
use axum::extract::Request;
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use serde_json::Value;

use crate::store::{Drawn, Preview};

/// The folder of the pictures within an octree's.
const FOLDER: &str = "preview";
/// No picture of ours is larger.
const LARGEST: usize = 64 << 20;
const FOR_EVER: HeaderValue = HeaderValue::from_static("private, max-age=31536000, immutable");
const ASK_AGAIN: HeaderValue = HeaderValue::from_static("private, no-cache");

/// How far an octree's pictures are, and where they are served.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct PreviewView {
    pub state: Drawn,
    pub attempts: u32,
    /// Why there are none, or none yet.
    pub error: Option<String>,
    /// The attribute that the colours show, or `height`.
    pub shows: Option<String>,
    pub assets: Vec<AssetView>,
}

/// One file.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct AssetView {
    pub url: String,
    #[serde(rename = "type")]
    pub media_type: String,
    /// In the words of STAC.
    pub roles: Vec<String>,
    pub width: u64,
    pub height: u64,
    pub frames: u64,
}

impl PreviewView {
    /// `octree` is where the octree is served.
    pub fn new(preview: Preview, octree: &str) -> PreviewView {
        let receipt = preview.receipt.unwrap_or_default();
        let stamp = preview.updated_at;
        let asset = |asset: &Value| {
            let text = |key: &str| asset[key].as_str().map(str::to_string);
            let number = |key: &str| asset[key].as_u64().unwrap_or_default();
            let roles = asset["roles"].as_array().into_iter().flatten();
            Some(AssetView {
                url: format!("{octree}/{FOLDER}/{}?v={stamp:x}", text("href")?),
                media_type: text("type")?,
                roles: roles.filter_map(|role| role.as_str().map(str::to_string)).collect(),
                width: number("width"),
                height: number("height"),
                frames: number("frames"),
            })
        };
        let assets = receipt["assets"].as_array().into_iter().flatten();
        PreviewView {
            state: preview.state,
            attempts: preview.attempts,
            error: preview.error,
            shows: receipt["shows"].as_str().map(str::to_string),
            assets: assets.filter_map(asset).collect(),
        }
    }

    /// The smallest still picture that is at least so wide.
    pub fn still(&self, wide: u64) -> Option<&AssetView> {
        let stills = self.assets.iter().filter(|asset| asset.frames <= 1 && asset.width >= wide);
        stills.min_by_key(|asset| asset.width)
    }

    /// One that a page shows as a picture; it may be there as a film too.
    pub fn turntable(&self) -> Option<&AssetView> {
        self.assets.iter().find(|asset| asset.frames > 1 && asset.media_type.starts_with("image/"))
    }
}

/// Says of pictures how long they may be kept, and answers who has them already.
pub(super) async fn keep(mut request: Request, next: Next) -> Response {
    if !is_of_pictures(request.uri().path()) {
        return next.run(request).await;
    }
    let is_stamped = request.uri().query().is_some_and(|query| query.starts_with("v="));
    let known = request.headers().get(header::IF_NONE_MATCH).cloned();
    // Pictures are small and sent whole, so that the tag is of all of it.
    for conditional in [header::IF_MODIFIED_SINCE, header::IF_UNMODIFIED_SINCE, header::RANGE] {
        request.headers_mut().remove(conditional);
    }
    if request.method() == Method::HEAD {
        // For the tag; the server itself leaves the body out.
        *request.method_mut() = Method::GET;
    }
    let answer = next.run(request).await;
    if answer.status() != StatusCode::OK {
        return answer;
    }
    let (mut parts, body) = answer.into_parts();
    parts.headers.insert(header::CACHE_CONTROL, if is_stamped { FOR_EVER } else { ASK_AGAIN });
    parts.headers.remove(header::LAST_MODIFIED);
    parts.headers.remove(header::ACCEPT_RANGES);
    let Ok(bytes) = to_bytes(body, LARGEST).await else {
        return StatusCode::INTERNAL_SERVER_ERROR.into_response();
    };
    let tag = format!("\"{}\"", blake3::hash(&bytes).to_hex());
    if let Ok(tag) = HeaderValue::from_str(&tag) {
        parts.headers.insert(header::ETAG, tag);
    }
    if known.is_some_and(|known| names(&known, &tag)) {
        return not_modified(&parts.headers);
    }
    Response::from_parts(parts, Body::from(bytes))
}

/// An octree may be called `preview` itself.
fn is_of_pictures(path: &str) -> bool {
    let parts: Vec<&str> = path.split('/').collect();
    matches!(parts[..], ["", "octrees", _, FOLDER, _] | ["", "shared", _, _, FOLDER, _])
}

fn not_modified(of: &HeaderMap) -> Response {
    let mut answer = StatusCode::NOT_MODIFIED.into_response();
    for name in [header::ETAG, header::CACHE_CONTROL] {
        if let Some(value) = of.get(&name) {
            answer.headers_mut().insert(name, value.clone());
        }
    }
    answer
}

/// Whether a list of tags, as browsers send it, has this one.
fn names(list: &HeaderValue, tag: &str) -> bool {
    let list = list.to_str().unwrap_or("");
    list.split(',').map(|one| one.trim().trim_start_matches("W/")).any(|one| one == tag || one == "*")
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn preview(receipt: Value) -> Preview {
        Preview { state: Drawn::Done, attempts: 1, error: None, receipt: Some(receipt), updated_at: 0x17f }
    }

    #[test]
    fn assets_get_the_address_of_their_octree_and_a_stamp() {
        let asset = |name: &str, width: u32, frames: u32| {
            json!({"href": name, "type": "image/x", "roles": ["thumbnail"], "width": width, "height": width,
                   "frames": frames, "bytes": 1, "unknown": {}})
        };
        let assets = [asset("big.png", 1600, 1), asset("t.png", 512, 1), asset("i.png", 128, 1)];
        let receipt =
            json!({"shows": "rgb", "assets": [assets[0], assets[1], assets[2], asset("r.webp", 512, 36)]});
        let view = PreviewView::new(preview(receipt), "/octrees/a%20b");
        assert_eq!(view.shows.as_deref(), Some("rgb"));
        assert_eq!(view.assets[0].url, "/octrees/a%20b/preview/big.png?v=17f");
        let width = |wide| view.still(wide).map(|still| still.width);
        assert_eq!(
            (width(100), width(500), width(1000), width(2000)),
            (Some(128), Some(512), Some(1600), None)
        );
        assert_eq!(view.turntable().expect("one").frames, 36);
    }

    #[test]
    fn a_receipt_that_is_none_is_a_preview_without_pictures() {
        for odd in [json!(null), json!([]), json!({"assets": [1, {"href": 3}]})] {
            assert!(PreviewView::new(preview(odd), "/octrees/a").assets.is_empty());
        }
    }

    #[test]
    fn only_pictures_are_answered_for() {
        assert!(is_of_pictures("/octrees/a/preview/thumbnail.png"));
        assert!(is_of_pictures("/octrees/preview/preview/preview.json"));
        for other in
            ["/octrees/preview/octree.bin", "/octrees/a/metadata.json", "/preview/x", "/octrees/preview"]
        {
            assert!(!is_of_pictures(other), "{other}");
        }
    }

    #[test]
    fn tags_are_known_again_in_any_list() {
        let list = |text: &str| HeaderValue::from_str(text).expect("a value");
        assert!(names(&list("\"a\", W/\"b\""), "\"b\"") && names(&list("*"), "\"b\""));
        assert!(!names(&list("\"ab\""), "\"b\""));
    }
}
