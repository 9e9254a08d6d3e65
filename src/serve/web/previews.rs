//! An octree's pictures, as the API tells of them and serves them.
//!
//! A name may stand for another octree tomorrow. So an address from the API
//! carries a stamp of its pictures and may be kept for ever; one without is asked
//! for again each time.

use axum::http::HeaderValue;
use serde::Serialize;
use serde_json::Value;

use crate::serve::queue::{Drawn, Preview};

/// The folder of the pictures within an octree's.
const FOLDER: &str = "preview";
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

/// How long copies of pictures may be kept.
pub(super) fn cache(query: Option<&str>) -> HeaderValue {
    let is_stamped = query.is_some_and(|query| query.starts_with("v="));
    if is_stamped { FOR_EVER } else { ASK_AGAIN }
}

/// Whether a path below the octrees is one of pictures. An octree may be called
/// `preview` itself.
pub(super) fn is_of_pictures(path: &str) -> bool {
    let parts: Vec<&str> = path.split('/').collect();
    matches!(parts[..], [_, FOLDER, _])
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
    fn only_pictures_are_kept_for_ever() {
        assert!(is_of_pictures("a/preview/thumbnail.png"));
        assert!(is_of_pictures("preview/preview/preview.json"));
        for other in ["preview/octree.bin", "a/metadata.json", "a/preview", "preview", "a/b/preview/x"] {
            assert!(!is_of_pictures(other), "{other}");
        }
        assert_eq!((cache(Some("v=17f")), cache(Some("x")), cache(None)), (FOR_EVER, ASK_AGAIN, ASK_AGAIN));
    }
}
