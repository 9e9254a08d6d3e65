//! Hostile names, links, foreign octrees, crashes and full disks.

mod crashes;
mod foreign;
mod inbox;
mod overwrite;
mod text;
