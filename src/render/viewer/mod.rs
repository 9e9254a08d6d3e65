//! What the viewer in the browser is sent of an octree: its description, its hierarchy in
//! pages, and the points of its nodes.
//!
//! Only bytes and values are made here, from an octree that is open; who may ask for
//! them and how long they are kept is `serve`'s. The browser's side is in
//! `serve/web/pages/assets/viewer/`: `hierarchy.js` reads the pages, `nodes.js` the points,
//! `selection.js` chooses nodes by the rule of `node_selection`. `scene.js` sizes points by
//! an earlier form of the rule in `scene`: it does not know specks and crowds yet.

pub mod attributes;
pub mod description;
pub mod pages;
pub mod points;

pub use attributes::Paint;
pub use description::Description;
