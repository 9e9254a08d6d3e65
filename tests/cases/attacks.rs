//! Hostile names, links, foreign octrees, crashes and full disks.

mod foreign;
mod inbox;
mod overwrite;
